"""What changes together goes to the browser in one message, whole and in its order."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("bokeh")

from bokeh.document import Document
from bokeh.models import ColumnDataSource, Div
from bokeh.protocol import Protocol

from maglev_ctrl.workbench.connection import OneMessage, together


class Socket:
    """What would send messages."""

    def __init__(self) -> None:
        self.sent: list[Any] = []

    async def send_message(self, message: Any) -> None:
        self.sent.append(message)


@pytest.fixture
def changed() -> Iterator[tuple[Document, Div, ColumnDataSource, list[Any]]]:
    document, words, numbers, events = Document(), Div(text="before"), ColumnDataSource({"x": [1.0]}), []
    document.add_root(words)
    document.add_root(numbers)
    document.callbacks.on_change(events.append)
    yield document, words, numbers, events


def test_changes_of_one_callback_are_one_message_in_their_order(changed: Any) -> None:
    _, words, numbers, events = changed
    socket = Socket()
    connection = OneMessage(Protocol(), socket, None, SimpleNamespace(subscribe=lambda one: None))
    words.text = "first"
    numbers.data = {"x": np.linspace(0.0, 1.0, 500)}
    words.text = "last"

    async def sent() -> None:
        for one in [connection.send_patch_document(event) for event in events]:
            await one

    asyncio.run(sent())
    (message,) = socket.sent
    told = json.loads(message.content_json)["events"]
    assert [one.get("new") for one in told if one.get("attr") == "text"] == ["first", "last"]
    assert len(told) == 3 and not message._buffers  # the numbers are inside
    # The next callback's changes are not held back by those that went.
    events.clear()
    words.text = "later"
    asyncio.run(sent())
    assert len(socket.sent) == 2 and "later" in socket.sent[1].content_json
    # What a callback had changed when it failed goes with the next one's changes, and nothing is held back for ever.
    events.clear()
    words.text = "failed"
    connection.send_patch_document(events[0])
    events.clear()
    words.text = "after"
    asyncio.run(sent())
    told = json.loads(socket.sent[2].content_json)["events"]
    assert len(socket.sent) == 3 and [one["new"] for one in told] == ["failed", "after"]


def test_a_message_makes_the_other_side_the_same(changed: Any) -> None:
    document, words, numbers, events = changed
    other = Document.from_json(document.to_json())
    words.text = "now"
    numbers.data = {"x": np.array([0.1, np.nan, -np.inf, 1e300]), "label": ["a", "", "$$x$$", "ä"]}
    message = Protocol().assemble(
        *(getattr(together(events), f"{part}_json") for part in ("header", "metadata", "content"))
    )
    message.apply_to_document(other)
    assert other.roots[0].text == "now"
    np.testing.assert_array_equal(other.roots[1].data["x"], numbers.data["x"])
    assert list(other.roots[1].data["label"]) == numbers.data["label"]


def test_a_page_that_has_gone_speaks_to_nobody(changed: Any) -> None:
    _, words, _, events = changed
    heard: list[Any] = []
    session = SimpleNamespace(subscribe=lambda one: None, unsubscribe=heard.append)
    connection = OneMessage(Protocol(), Socket(), None, session)
    assert connection.session is session
    words.text = "late"
    message = together(events)
    connection.detach_session()
    assert heard == [connection]
    answer = asyncio.run(connection.session._handle_patch(message, connection))
    assert answer.msgtype == "OK" and answer.header["reqid"] == message.header["msgid"]
    assert asyncio.run(connection.session._handle_pull(message, connection)).msgtype == "ERROR"
    connection.session.notify_connection_lost()
