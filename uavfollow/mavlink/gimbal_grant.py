"""Who has the gimbal: asked for once per selection, kept while nobody else takes it, given back at the end."""

from __future__ import annotations

from enum import Enum

from uavfollow.mavlink.commands import CommandQueue, Outcome
from uavfollow.mavlink.gimbal import gimbal_release_control, gimbal_take_control
from uavfollow.mavlink.ids import CMD_GIMBAL_MANAGER_CONFIGURE, CONFIGURE_RELEASE


class GrantState(str, Enum):
    """Whether gimbal messages may be sent, and why not."""

    NOT_ASKED = "not_asked"
    ASKED = "asked"
    HELD = "held"
    REFUSED = "refused"  # the manager said no, or nothing
    TAKEN = "taken"  # by someone else; it stays theirs until it is asked for again
    RELEASED = "released"


class GimbalGrant:
    """Primary control of one gimbal. Messages may be sent only while HELD."""

    def __init__(self, own_system: int, own_component: int, target_system: int, device_id: int) -> None:
        self._own = (own_system, own_component)
        self._target_system = target_system
        self._device_id = device_id
        self._was_ours = False
        self.state = GrantState.NOT_ASKED

    def ask(self, queue: CommandQueue) -> None:
        """Ask the manager for control; does nothing while it is held or asked for."""
        if self.state in (GrantState.HELD, GrantState.ASKED):
            return
        queue.add(gimbal_take_control(*self._own, self._target_system, self._device_id))
        self.state, self._was_ours = GrantState.ASKED, False

    def release(self, queue: CommandQueue) -> None:
        """Give control back, if it is ours or asked for."""
        if self.state in (GrantState.HELD, GrantState.ASKED):
            queue.add(gimbal_release_control(self._target_system, self._device_id))
            self.state = GrantState.RELEASED

    def lost(self) -> None:
        """The autopilot was restarted: nothing that was granted before holds."""
        if self.state in (GrantState.HELD, GrantState.ASKED):
            self.state = GrantState.REFUSED

    def update(self, outcomes: list[Outcome], primary: tuple[int, int] | None) -> None:
        """Take the answers to commands and the primary controller that GIMBAL_MANAGER_STATUS named last."""
        for outcome in outcomes:
            if outcome.command == CMD_GIMBAL_MANAGER_CONFIGURE and outcome.param1 != CONFIGURE_RELEASE:
                self._answered(outcome)
        if self.state is not GrantState.HELD or primary is None:
            return
        if primary == self._own:
            self._was_ours = True
        elif self._was_ours:
            # A status from before the grant still names the one before; only a change away from us is a taking.
            self.state = GrantState.TAKEN

    def _answered(self, outcome: Outcome) -> None:
        if self.state is GrantState.ASKED:
            self.state = GrantState.HELD if outcome.accepted else GrantState.REFUSED
