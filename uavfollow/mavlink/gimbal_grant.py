"""Who has the gimbal: asked for once per selection, kept while nobody else takes it, given back at the end."""

from __future__ import annotations

import math
from enum import Enum

from uavfollow.mavlink.commands import CommandQueue, Outcome
from uavfollow.mavlink.gimbal import gimbal_release_control, gimbal_take_control
from uavfollow.mavlink.ids import CMD_GIMBAL_MANAGER_CONFIGURE, CONFIGURE_RELEASE

# A status this long after the yes must name us; a later one that names another means that we missed the taking.
SETTLED_S = 1.0


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
        self._held_s = -math.inf
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

    def update(self, outcomes: list[Outcome], primary: tuple[int, int] | None, primary_s: float, now_s: float) -> None:
        """Take the answers to commands, and the primary controller that GIMBAL_MANAGER_STATUS named last, and when."""
        for outcome in outcomes:
            if outcome.command == CMD_GIMBAL_MANAGER_CONFIGURE and outcome.param1 != CONFIGURE_RELEASE:
                self._answered(outcome, now_s)
        if self.state is not GrantState.HELD or primary is None or primary_s <= self._held_s:
            return  # a status from before the grant names the one before
        if primary == self._own:
            self._was_ours = True
        elif self._was_ours or primary_s > self._held_s + SETTLED_S:
            self.state = GrantState.TAKEN

    def _answered(self, outcome: Outcome, now_s: float) -> None:
        if self.state is GrantState.ASKED:
            self.state = GrantState.HELD if outcome.accepted else GrantState.REFUSED
            self._held_s = now_s
