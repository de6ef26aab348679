"""One link with the components that speak on it: the only way a message takes to the wire."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

from uavfollow.mavlink.packer import Message, Packer, Parser, ParserStats
from uavfollow.mavlink.transport import Link

log = logging.getLogger(__name__)


class Connection:
    """Owns a link, one packer for each of our components and one parser. For one thread.

    `tap` is called with the bytes of every frame sent and every message received, for recording. A tap that fails is
    counted in `tap_failures` and must not stop what flies.
    """

    def __init__(
        self, link: Link, system_id: int, component_ids: Iterable[int], tap: Callable[[bytes], None] | None = None
    ) -> None:
        self.link = link
        self.system_id = system_id
        self._packers = {component_id: Packer(system_id, component_id) for component_id in component_ids}
        self._parser = Parser()
        self._tap = tap
        self.tap_failures = 0

    def send(self, component_id: int, message: Message) -> None:
        """Send a message from one of our components. Raises `PackError`, or `ValueError` for a foreign component."""
        packer = self._packers.get(component_id)
        if packer is None:
            own = ", ".join(str(own_id) for own_id in self._packers)
            raise ValueError(f"component {component_id} does not speak on this connection; it has {own or 'none'}")
        frame = packer.pack(message)
        self.link.write(frame)
        self._record(frame)

    def receive(self) -> list[Message]:
        """All messages that have arrived, in order; empty when there are none. Never blocks."""
        messages = self._parser.parse(self.link.read_available())
        if self._tap is not None:
            for message in messages:
                self._record(bytes(message.get_msgbuf()))
        return messages

    def _record(self, frame: bytes) -> None:
        if self._tap is None:
            return
        try:
            self._tap(frame)
        except Exception as error:
            self.tap_failures += 1
            if self.tap_failures == 1:
                log.error("recording failed, the rest of the flight is not recorded whole: %s", error)

    @property
    def parser_stats(self) -> ParserStats:
        """Messages, unknown ids and bad bytes received."""
        return self._parser.stats

    def close(self) -> None:
        """Close the link."""
        self.link.close()
