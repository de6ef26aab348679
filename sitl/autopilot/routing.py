"""ArduPilot's routing between links: who was heard where, what is passed on, what is the autopilot's own.

A component is known by (sysid, compid) on the links on which it was heard. A message addressed to a component that
was heard nowhere else is treated as if it were for the autopilot.
"""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.channel import AUTOPILOT_COMPID, Channel, Message

# As large as ArduPilot's table: a flood of invented senders must not grow it.
ROUTES_MAX = 20
# What talks about one radio link only.
NEVER_FORWARDED = frozenset(
    {mavlink.MAVLINK_MSG_ID_RADIO, mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_ADSB_VEHICLE}
)


class Routes:
    """Learns senders and decides about each message."""

    __slots__ = ("_routes", "sysid")

    def __init__(self, sysid: int) -> None:
        self.sysid = sysid
        self._routes: list[tuple[int, int, Channel]] = []

    def forget(self) -> None:
        """As after a reboot."""
        self._routes.clear()

    def handle(self, message: Message, source: Channel, channels: list[Channel]) -> bool:
        """Pass `message` on where it belongs; True when the autopilot itself is (also) meant."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if sender == (self.sysid, AUTOPILOT_COMPID):
            return True  # our own words, come back
        self._learn(sender, source)
        message_id = message.get_msgId()
        if message_id in NEVER_FORWARDED:
            return True
        if message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self._spread_heartbeat(message, sender, source, channels)
            return True
        return self._forward(message, source)

    def _learn(self, sender: tuple[int, int], source: Channel) -> None:
        route = (*sender, source)
        if sender[0] != 0 and route not in self._routes and len(self._routes) < ROUTES_MAX:
            self._routes.append(route)

    def _spread_heartbeat(
        self, message: Message, sender: tuple[int, int], source: Channel, channels: list[Channel]
    ) -> None:
        """To every other link but those on which the same component is heard (a loop)."""
        heard_on = [channel for sysid, compid, channel in self._routes if (sysid, compid) == sender]
        for channel in channels:
            if channel is not source and channel not in heard_on:
                channel.forward(message)

    def _forward(self, message: Message, source: Channel) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        to_all = system == 0
        matches = to_all or system == self.sysid
        mine = matches and component in (0, AUTOPILOT_COMPID)
        if mine and not to_all and component != 0:
            return True
        sent: list[Channel] = []
        for sysid, compid, channel in self._routes:
            wanted = to_all or (system == sysid and (component in (0, compid) or not matches))
            if wanted and channel is not source and channel not in sent:
                channel.forward(message)
                sent.append(channel)
        return mine or (matches and not sent)
