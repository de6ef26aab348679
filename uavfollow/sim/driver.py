"""The application as the simulator drives it: `Companion` behind the simulator's protocol."""

from __future__ import annotations

from sitl.drive import Decision, Seen
from tracker.box import Box
from tracker.messages import Candidate, Frame
from uavfollow.companion import Companion, LoopRecord


class CompanionDriver:
    """Implements `sitl.drive.Application`."""

    def __init__(self, companion: Companion) -> None:
        self._companion = companion

    def poll(self, now_s: float) -> None:
        """One round of the application's loop."""
        self._companion.poll(now_s)

    def select(self, seen: Seen, box: Box, now_s: float) -> Decision:
        """The operator's box. Raises ValueError when it cannot be selected."""
        return decision(self._companion.select(_frame(seen), box, now_s, seen.t_capture_s))

    def searched_px(self, t_capture_s: float) -> tuple[tuple[float, float], ...]:
        """Centre of the search region in the picture of that time."""
        return self._companion.searched_px(t_capture_s)

    def searches(self, t_capture_s: float) -> int:
        """How many network calls the picture of that time will take."""
        return self._companion.searches(t_capture_s)

    def see(self, seen: Seen, now_s: float) -> Decision:
        """One picture, or the candidates of one."""
        frame = _frame(seen)
        what = frame if frame is not None else _candidates(seen)
        return decision(self._companion.see(what, now_s, seen.t_capture_s))

    def start_following(self, now_s: float) -> str:
        """The reason of the supervisor's answer."""
        return self._companion.start_following(now_s).reason.value

    def stop_following(self, now_s: float) -> None:
        """End following."""
        self._companion.stop_following(now_s)

    def close(self, now_s: float) -> None:
        """End in order."""
        self._companion.close(now_s)


def decision(record: LoopRecord) -> Decision:
    """A cycle in the simulator's words."""
    step = record.step
    target, velocity, gimbal = step.target, step.velocity_command, step.gimbal_command
    return Decision(
        status=target.status.value,
        reason=target.reason.value,
        box=target.box,
        confidence=target.confidence,
        v_ned_m_s=velocity.v_ned_m_s,
        yaw_rate_rad_s=velocity.yaw_rate_rad_s,
        command_reason=velocity.reason.value,
        gimbal_rate_rad_s=(gimbal.pitch_rate_rad_s, gimbal.yaw_rate_rad_s),
        gimbal_reason=gimbal.reason.value,
        may_fly=record.flight.allowed,
        flight_reason=record.flight.reason.value,
        fault=step.fault,
        record=record,
    )


def _frame(seen: Seen) -> Frame | None:
    if seen.image_bgr_u8 is None:
        return None
    return Frame(seen.image_bgr_u8, seen.seq, seen.t_capture_s, seen.t_receive_s)


def _candidates(seen: Seen) -> tuple[Candidate, ...]:
    return tuple(Candidate(m.box, m.score, m.score, m.score) for m in seen.candidates or ())
