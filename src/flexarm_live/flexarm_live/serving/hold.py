"""Hand on the set-point: one client has it at a time."""

from __future__ import annotations

from flexarm_live.serving.requests import RequestError


class Hold:
    """Hand on the set-point.

    Attributes
    ----------
    holder : str
        Name of the client that has it; empty when nobody has.
    """

    def __init__(self) -> None:
        self.holder = ""

    def take(self, client: str) -> None:
        """Give it to a client, which may have it already.

        Raises
        ------
        RequestError
            When another one has it.
        """
        if self.holder and self.holder != client:
            raise RequestError(f"{self.holder} has the hand on the set-point: it has to let go")
        self.holder = client

    def let_go(self, client: str) -> bool:
        """Take it from a client; return whether the client had it."""
        had = self.holder == client
        if had:
            self.holder = ""
        return had
