"""Connections that bring no request in time, or wait for their next one, make room for others."""

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol

from nearfar.app.configuration import Limits


class ImpatientProtocol(H11Protocol):
    """HTTP that closes connections whose head does not arrive, and the longest idle of too many.

    uvicorn itself waits without end for the first request of a connection, and for the rest of a
    request whose head has begun, and refuses everybody when it has many connections.

    Attributes:
        limits: time of a head, and number of connections; a subclass may have others.
    """

    limits = Limits()

    _timer: asyncio.TimerHandle | None = None
    _idle_since = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first request; make room where there are too many."""
        super().connection_made(transport)
        self._wait_for_head()
        if len(self.connections) > self.limits.connections:
            ours = (each for each in self.connections if isinstance(each, ImpatientProtocol))
            idle = (each for each in ours if each.is_idle)
            oldest = min(idle, key=lambda each: each._idle_since, default=None)
            if oldest is not None:
                oldest.transport.abort()

    def data_received(self, data: bytes) -> None:
        """Take bytes; the head of a request must be whole in time."""
        super().data_received(data)
        if not self.is_idle:
            self._stop_waiting()
        elif self._timer is None:
            self._wait_for_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        self._stop_waiting()
        super().connection_lost(exc)

    @property
    def is_idle(self) -> bool:
        """Whether no request is under way."""
        return self.cycle is None or self.cycle.response_complete

    def _wait_for_head(self) -> None:
        self._idle_since = self.loop.time()
        self._timer = self.loop.call_later(self.limits.head_seconds, self._give_up)

    def _stop_waiting(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _give_up(self) -> None:
        self._timer = None
        if self.is_idle:
            self.transport.abort()


def impatient_protocol(limits: Limits) -> type[H11Protocol]:
    """Return a protocol with limits, for `uvicorn.Config`."""
    return type("LimitedProtocol", (ImpatientProtocol,), {"limits": limits})
