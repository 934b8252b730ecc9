"""A list and its changes, whatever the server and the network do."""

from __future__ import annotations

import json
import logging
import threading

import pytest

from contextpolicy.cluster import watching
from contextpolicy.cluster.paging import FIRST, GROW, Page
from contextpolicy.cluster.watching import ObjectWatch
from contextpolicy.errors import ActuationError
from tests.waiting import PATIENCE

UNREACHABLE = ActuationError("Unreachable", "nobody there", retriable=True)


def an_item(name, version=1, uid=None):
    return {"metadata": {"name": name, "uid": uid or f"uid-{name}", "resourceVersion": str(version)}}


LIST = f"/pods?limit={FIRST}"


def a_list(*items, version=1, more=None):
    """A list, or one page of it: `more` is the token for the next."""
    return {"metadata": {"resourceVersion": str(version), **({"continue": more} if more else {})}, "items": list(items)}


def an_event(kind, item):
    return json.dumps({"type": kind, "object": item}).encode() + b"\n"


class Response:
    """Sends its chunks, then ends; one without an end lasts until somebody shuts it down."""

    def __init__(self, *chunks, endless=False):
        self._chunks, self._down, self.closed = chunks, threading.Event(), False
        if not endless:
            self._down.set()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.closed = True

    def stream(self, **_):
        for chunk in self._chunks:
            if isinstance(chunk, Exception):
                raise chunk
            yield chunk
        assert self._down.wait(PATIENCE)

    def shutdown(self):
        self._down.set()
        if self.closed:
            raise ValueError("as urllib3 says it")


class Api:
    """Answers as the script says; when it ends, a silent watch."""

    def __init__(self, *script):
        self._script, self.asked = list(script), []
        self.quiet = Response(endless=True)
        self.idle = threading.Event()

    def read_page(self, path, _most):
        found = self._answer(path)
        return Page(found, len(json.dumps(found)))

    def watch(self, path, version):
        return self._answer(f"{path} since {version}")

    def _answer(self, question):
        self.asked.append(question)
        if not self._script:
            self.idle.set()
            return self.quiet
        answer = self._script.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer


@pytest.fixture(autouse=True)
def _no_pauses(monkeypatch):
    monkeypatch.setattr(watching, "PAUSES", (0.0,))


class Notes:
    """What a watch reports."""

    def __init__(self):
        self.objects = []

    def on_object(self, item):
        self.objects.append(item["metadata"]["name"])

    def on_gone(self, uid):
        self.objects.append(f"-{uid}")

    def on_listing(self):
        pass


def follow(*script):
    """What a watch reports and asks, until the script has ended."""
    api, notes = Api(*script), Notes()
    reported = notes.objects
    watch = ObjectWatch(api, "/pods", notes)
    watch.start()
    assert api.idle.wait(PATIENCE)
    watch.check()
    assert watch.listed.done()
    watch.stop()
    assert api.quiet.closed
    return reported, api.asked


def test_watch_reports_existing_objects_then_changes():
    events = an_event("ADDED", an_item("speech", 5)) + an_event("MODIFIED", an_item("slam", 6))
    reported, asked = follow(
        a_list(an_item("slam"), version=4), Response(events, an_event("DELETED", an_item("slam", 7)))
    )
    assert reported == ["slam", "speech", "slam", "-uid-slam"]
    assert asked == [LIST, "/pods since 4", "/pods since 7"]


def test_a_paged_list_is_watched_from_its_common_resource_version():
    pages = a_list(an_item("slam"), version=4, more="a/b=="), a_list(an_item("speech"), version=4)
    reported, asked = follow(*pages)
    assert reported == ["slam", "speech"]
    assert asked == [LIST, f"/pods?limit={FIRST * GROW}&continue=a/b%3D%3D", "/pods since 4"]


def test_a_list_whose_pages_have_expired_starts_over_and_forgets_nothing():
    gone = ActuationError("Expired", "the continue token is too old", retriable=True)
    first = a_list(an_item("slam"), version=4, more="next")
    later = [a_list(an_item("speech"), version=version) for version in (9, 12)]
    reported, asked = follow(first, gone, later[0], gone, later[1])
    assert reported == ["slam", "speech", "-uid-slam", "speech"], "it went between the first two lists"
    assert asked[-1] == "/pods since 12"


@pytest.mark.parametrize("kind", ["MODIFIED", "ADDED"])
def test_object_that_takes_over_a_name_ends_the_one_before(kind, caplog):
    """A server whose cache missed the deletion shows it as one change."""
    caplog.set_level("INFO")
    reported, _ = follow(a_list(an_item("slam"), version=4), Response(an_event(kind, an_item("slam", 7, "new"))))
    assert reported == ["slam", "-uid-slam", "slam"]
    assert "slam was deleted and re-created; the watch did not report its deletion" in caplog.text


def test_replaced_object_that_is_deleted_ends_both():
    reported, _ = follow(a_list(an_item("slam"), version=4), Response(an_event("DELETED", an_item("slam", 7, "new"))))
    assert reported[0] == "slam"
    assert sorted(reported[1:]) == ["-new", "-uid-slam"]


def test_object_replaced_between_two_lists_is_gone_before_the_next_comes():
    lost = ActuationError("Expired", "too old", retriable=True)
    lists = a_list(an_item("slam"), version=4), lost, a_list(an_item("slam", 7, "new"), version=9)
    reported, _ = follow(*lists)
    assert reported == ["slam", "-uid-slam", "slam"]


def test_an_object_deeper_than_python_decodes_is_reported_like_others():
    deep = an_event("ADDED", {**an_item("deep", 5), "example": 5}).replace(
        b": 5}", b": " + b"[" * 10_000 + b"]" * 10_000 + b"}"
    )
    reported, asked = follow(a_list(version=4), Response(deep, an_event("ADDED", an_item("slam", 6))))
    assert reported == ["deep", "slam"]
    assert asked == [LIST, "/pods since 4", "/pods since 6"]


def test_events_may_be_split_across_chunks():
    event = an_event("ADDED", an_item("slam", 5))
    reported, _ = follow(a_list(), Response(event[:7], event[7:] + event[:20], event[20:]))
    assert reported == ["slam", "slam"]


def test_bookmark_only_advances_the_version():
    reported, asked = follow(a_list(), Response(an_event("BOOKMARK", {"metadata": {"resourceVersion": "99"}})))
    assert (reported, asked[-1]) == ([], "/pods since 99")


def test_failure_relists_and_reports_missing_objects_as_gone():
    reported, asked = follow(
        a_list(an_item("slam"), an_item("speech"), version=4),
        Response(an_event("ADDED", an_item("map", 5)), OSError("connection reset")),
        UNREACHABLE,
        UNREACHABLE,
        a_list(an_item("slam"), version=2),
    )
    assert reported[:4] == ["slam", "speech", "map", "slam"]
    assert sorted(reported[4:]) == ["-uid-map", "-uid-speech"]
    assert asked[-1] == "/pods since 2", "a restored backup counts from where it was"


@pytest.mark.parametrize(
    "broken",
    [
        UNREACHABLE,
        Response(an_event("ERROR", {"code": 410, "reason": "Expired", "message": "too old"})),
        Response(b"<html>\n"),
        Response(b'{"type": "ADDED"}\n'),
        Response(b"[]\n"),
    ],
    ids=["unreachable", "expired", "no JSON", "no object", "no event"],
)
def test_a_watch_that_fails_in_any_way_is_restarted(broken):
    reported, asked = follow(a_list(version=4), broken, a_list(an_item("slam"), version=8))
    assert reported == ["slam"]
    assert asked[2:] == [LIST, "/pods since 8"]


def test_failures_are_logged_once_and_their_end(caplog):
    caplog.set_level(logging.INFO)
    follow(UNREACHABLE, UNREACHABLE, {"kind": "Status"}, a_list())
    messages = [record.getMessage() for record in caplog.records if record.name == watching.__name__]
    assert messages == ["/pods: watch failed, retrying: nobody there", "/pods: watch re-established"]


class RefusedAfterTheEnd(Response):
    """What urllib3 says to a shutdown when the server has just ended the answer."""

    def __init__(self, error):
        super().__init__(endless=True)
        self._error = error

    def shutdown(self):
        super().shutdown()
        raise self._error


@pytest.mark.parametrize(
    "error", [OSError(9, "Bad file descriptor"), ValueError("closed"), RuntimeError("released")], ids=repr
)
def test_watch_can_be_stopped_while_its_stream_ends(error):
    api = Api(a_list())
    api.quiet = RefusedAfterTheEnd(error)
    watch = ObjectWatch(api, "/pods", Notes())
    watch.start()
    assert api.idle.wait(PATIENCE)
    watch.stop()
    assert api.quiet.closed


def test_a_watch_can_be_stopped_in_the_pause_after_an_end(monkeypatch):
    monkeypatch.setattr(watching, "PAUSES", (PATIENCE,))
    ended = Response()
    api = Api(a_list(), ended)
    watch = ObjectWatch(api, "/pods", Notes())
    watch.start()
    watch.listed.result(PATIENCE)
    while not ended.closed:
        watch._thread.join(0.001)
    watch.stop()
    assert not watch._thread.is_alive()
    assert not api.idle.is_set(), "it was stopped before it went on"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_dead_watch_thread_is_detected():
    class Ends(Notes):
        def on_object(self, _):
            raise SystemExit

    watch = ObjectWatch(Api(a_list(an_item("slam"))), "/pods", Ends())
    watch.start()
    watch._thread.join(PATIENCE)
    with pytest.raises(RuntimeError, match="/pods is no longer watched"):
        watch.check()


class NotesRefusals(Notes):
    watch: ObjectWatch | None = None

    def __init__(self):
        super().__init__()
        self.refusals: list[str] = []

    def on_listing(self):
        assert self.watch is not None
        self.refusals.append(self.watch.refused)


def watched(api):
    """What the listener sees of refusals until everything was listed."""
    notes = NotesRefusals()
    notes.watch = watch = ObjectWatch(api, "/pods", notes)
    watch.start()
    watch.listed.result(PATIENCE)
    watch.stop()
    return notes.refusals


def test_a_refusal_is_reported_when_it_begins_and_when_it_ends():
    forbidden = ActuationError("Forbidden", "no right to list", retriable=False)
    assert watched(Api(forbidden, forbidden, a_list(an_item("slam")))) == ["no right to list", "", ""]


def test_unreachable_server_is_not_a_refusal():
    assert watched(Api(UNREACHABLE, a_list())) == [""]
