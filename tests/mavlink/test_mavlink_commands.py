"""One command after the other, each until it is answered; and who has the gimbal."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from uavfollow.mavlink.commands import MAX_TRIES, CommandQueue, message_interval, request_message
from uavfollow.mavlink.gimbal_grant import GimbalGrant, GrantState

OWN = (1, 191)


def ack(command: int, result: int = 0, target: tuple[int, int] = OWN):
    return dialect.MAVLink_command_ack_message(command, result, 0, 0, *target)


def queue(*message_ids: int) -> CommandQueue:
    made = CommandQueue(*OWN)
    for message_id in message_ids:
        made.add(message_interval(1, message_id, 50.0))
    return made


def test_fields_of_an_interval():
    message = message_interval(1, 30, 50.0)
    assert (message.command, message.param1, message.param2) == (dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 20000)
    assert (message.target_system, message.target_component) == (1, 1)
    assert request_message(1, 280).command == dialect.MAV_CMD_REQUEST_MESSAGE


def test_the_next_waits_for_the_answer():
    commands = queue(30, 32)
    assert commands.due(0.0).param1 == 30
    assert commands.due(0.1) is None
    commands.answered(ack(511))
    assert commands.due(0.2).param1 == 32
    commands.answered(ack(511, result=4))
    assert commands.is_idle
    assert [(o.param1, o.accepted) for o in commands.outcomes] == [(30, True), (32, False)]


def test_repeated_every_second_then_given_up():
    commands, sent = queue(30, 32), []
    for tenth in range(10 * (MAX_TRIES + 1)):
        message = commands.due(tenth / 10)
        if message is not None:
            sent.append((tenth / 10, message.param1, message.confirmation))
    assert sent[:MAX_TRIES] == [(float(k), 30, k) for k in range(MAX_TRIES)]
    assert sent[MAX_TRIES] == (float(MAX_TRIES), 32, 0), "the next one has its turn"
    assert commands.outcomes[0].result is None


@pytest.mark.parametrize("foreign", [ack(512), ack(511, target=(255, 190)), ack(511, result=5)])
def test_answers_that_are_not_ours_change_nothing(foreign):
    commands = queue(30)
    commands.due(0.0)
    commands.answered(foreign)
    assert not commands.is_idle


def test_an_answer_before_anything_was_sent_is_not_ours():
    commands = queue(30)
    commands.answered(ack(511))
    assert not commands.is_idle


def grant_after(result: int | None) -> tuple[GimbalGrant, CommandQueue]:
    commands, grant = CommandQueue(*OWN), GimbalGrant(*OWN, 1, 1)
    grant.ask(commands)
    for k in range(MAX_TRIES + 1):
        commands.due(float(k))
        if result is not None:
            commands.answered(ack(1001, result))
            break
    grant.update(commands.outcomes, None, -math.inf, 5.0)
    commands.outcomes.clear()
    return grant, commands


@pytest.mark.parametrize(
    ("result", "state"), [(0, GrantState.HELD), (2, GrantState.REFUSED), (None, GrantState.REFUSED)]
)
def test_control_is_held_only_after_a_yes(result, state):
    assert grant_after(result)[0].state is state


def test_taken_by_someone_else_stays_taken_until_asked_again():
    grant, commands = grant_after(0)
    grant.update([], (255, 190), 4.9, 5.1)
    assert grant.state is GrantState.HELD, "a status from before the grant"
    grant.update([], OWN, 5.2, 5.2)
    grant.update([], (255, 190), 5.4, 5.4)
    assert grant.state is GrantState.TAKEN
    grant.update([], OWN, 5.6, 5.6)
    assert grant.state is GrantState.TAKEN
    grant.ask(commands)
    assert grant.state is GrantState.ASKED


def test_release_sends_minus_three_once():
    grant, commands = grant_after(0)
    grant.release(commands)
    grant.release(commands)
    message = commands.due(10.0)
    assert (message.command, message.param1, message.param2) == (1001, -3.0, -3.0)
    commands.answered(ack(1001))
    assert commands.is_idle
    grant.update(commands.outcomes, (0, 0), 11.0, 11.0)
    assert grant.state is GrantState.RELEASED


def test_a_taking_that_was_missed_is_noticed():
    """The one status that named us was lost: a later one that names another says enough."""
    grant, _ = grant_after(0)
    grant.update([], (255, 190), 5.9, 5.9)
    assert grant.state is GrantState.HELD, "the manager may be slow to say so"
    grant.update([], (255, 190), 6.1, 6.1)
    assert grant.state is GrantState.TAKEN


def test_a_restart_of_the_autopilot_takes_the_gimbal():
    grant, _ = grant_after(0)
    grant.lost()
    assert grant.state is GrantState.REFUSED
