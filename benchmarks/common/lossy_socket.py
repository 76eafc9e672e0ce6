"""A datagram socket over loopback whose packets are late, lost or doubled, each way.

a packet arrives `delay` later, with the probability 1 − `loss`, and then twice with the probability `loss`
"""

from __future__ import annotations

import contextlib
import random
import socket
from collections import deque
from time import monotonic


class LossySocket:
    """Sends to one port of this machine, and hears what is answered.

    Attributes:
        loss: share of packets lost, each way, and as many of the rest doubled.
        delay: of each packet, each way [s].
    """

    def __init__(self, port: int, loss: float = 0.0, delay: float = 0.0) -> None:
        self.loss, self.delay = loss, delay
        self._to = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.001)
        self._random = random.Random(0)
        self._out = deque[tuple[float, bytes]]()
        self._in = deque[tuple[float, bytes]]()

    def send(self, packet: bytes) -> None:
        """Send a packet, when its time has come."""
        self._pass(packet, self._out)
        self._flush()

    def receive(self) -> list[bytes]:
        """What has arrived by now; waits a millisecond for more."""
        self._flush()
        with contextlib.suppress(OSError):
            self._pass(self._socket.recvfrom(4096)[0], self._in)
        arrived = []
        while self._in and self._in[0][0] <= monotonic():
            arrived.append(self._in.popleft()[1])
        return arrived

    def close(self) -> None:
        """Leave."""
        self._socket.close()

    def _pass(self, packet: bytes, queue: deque[tuple[float, bytes]]) -> None:
        if self._random.random() >= self.loss:
            for _ in range(1 + (self._random.random() < self.loss)):
                queue.append((monotonic() + self.delay, packet))

    def _flush(self) -> None:
        while self._out and self._out[0][0] <= monotonic():
            with contextlib.suppress(OSError):
                self._socket.sendto(self._out.popleft()[1], self._to)
