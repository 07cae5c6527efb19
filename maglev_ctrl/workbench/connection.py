"""One message for all that changed together: a view is some thirty changes, a hundred parts in Bokeh's own way."""

from __future__ import annotations

from collections.abc import Awaitable, Generator, Sequence
from dataclasses import dataclass
from typing import Any

from bokeh.core.serialization import Serializer
from bokeh.document.events import DocumentPatchedEvent
from bokeh.protocol.messages.patch_doc import patch_doc
from bokeh.server.connection import ServerConnection


class OneMessage(ServerConnection):  # type: ignore[misc]
    """A connection that sends the changes of one callback together, their numbers inside the text."""

    _waiting: tuple[DocumentPatchedEvent, ...] = ()

    @property
    def session(self) -> Any:
        """The page's session; a page that has gone may still have something to say, and says it to nobody."""
        return _NOBODY if self._session is None else self._session

    def send_patch_document(self, event: DocumentPatchedEvent) -> Awaitable[None]:
        """Note a change; whichever turn comes first sends all that were noted by then, also those of a callback that
        failed before its own turns came."""
        self._waiting = (*self._waiting, event)
        return _Turn(self)

    async def _send(self) -> None:
        events, self._waiting = self._waiting, ()
        if events:
            await self._socket.send_message(together(events))


class _Nobody:
    """Hears what a page said before it went."""

    async def _handle_patch(self, message: Any, connection: ServerConnection) -> Any:
        return connection.ok(message)

    async def _handle_pull(self, message: Any, connection: ServerConnection) -> Any:
        return connection.error(message, "the page has gone")

    _handle_push = _handle_pull

    def notify_connection_lost(self) -> None:
        """It was lost before."""


_NOBODY = _Nobody()


@dataclass(frozen=True, slots=True)
class _Turn:
    """A connection's turn to send; one that never comes is no fault of anybody, as a coroutine's would be."""

    connection: OneMessage

    def __await__(self) -> Generator[Any, None, None]:
        return self.connection._send().__await__()


def together(events: Sequence[DocumentPatchedEvent]) -> Any:
    """A message with all changes of one document in their order; arrays as text, because every binary part of a
    message is two more frames on the way."""
    models = events[0].document.models
    serializer = Serializer(references=models.synced_references, deferred=False)
    message = patch_doc(patch_doc.create_header(), {}, {"events": serializer.encode(list(events))})
    models.flush_synced(lambda model: not serializer.has_ref(model))
    return message
