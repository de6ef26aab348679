"""One link with the components that speak on it: the only way a message takes to the wire."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from uavfollow.mavlink.packer import Message, Packer, Parser, ParserStats
from uavfollow.mavlink.transport import Link


class Connection:
    """Owns a link, one packer for each of our components and one parser. For one thread.

    `tap` is called with the bytes of every frame sent and every message received, for recording; what it raises
    passes through.
    """

    def __init__(
        self, link: Link, system_id: int, component_ids: Iterable[int], tap: Callable[[bytes], None] | None = None
    ) -> None:
        self.link = link
        self.system_id = system_id
        self._packers = {component_id: Packer(system_id, component_id) for component_id in component_ids}
        self._parser = Parser()
        self._tap = tap

    def send(self, component_id: int, message: Message) -> None:
        """Send a message from one of our components. Raises `PackError`, or `ValueError` for a foreign component."""
        packer = self._packers.get(component_id)
        if packer is None:
            own = ", ".join(str(own_id) for own_id in self._packers)
            raise ValueError(f"component {component_id} does not speak on this connection; it has {own or 'none'}")
        frame = packer.pack(message)
        self.link.write(frame)
        if self._tap is not None:
            self._tap(frame)

    def receive(self) -> list[Message]:
        """All messages that have arrived, in order; empty when there are none. Never blocks."""
        messages = self._parser.parse(self.link.read_available())
        if self._tap is not None:
            for message in messages:
                self._tap(bytes(message.get_msgbuf()))
        return messages

    @property
    def parser_stats(self) -> ParserStats:
        """Messages, unknown ids and bad bytes received."""
        return self._parser.stats

    def close(self) -> None:
        """Close the link."""
        self.link.close()
