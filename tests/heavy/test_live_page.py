"""The live page in a real browser, on a desk and on a phone; the pictures of the documents are made on a `node`."""

from __future__ import annotations

import json
import re
import time
from importlib.resources import files
from itertools import pairwise

import pytest

from contextpolicy.explain.palette import context_colors, task_colors
from contextpolicy.live.page_server import PageServer
from tests.heavy.browser import Browser
from tests.heavy.live_robot import STORY, TASKS, Disturbed, a_robot, many, run
from tests.waiting import PATIENCE

AXE = files("axe_core_python") / "axe.min.js"


@pytest.fixture
def robot():
    """An operator whose robot has had an eventful minute and a half."""
    with pytest.MonkeyPatch.context() as patch:
        yield run(patch, a_robot(), STORY)


@pytest.fixture
def watched(robot):
    return Disturbed(robot)


@pytest.fixture
def server(watched):
    opened = PageServer(0, watched)
    opened.start()
    yield opened
    opened.close()


@pytest.fixture
def page(server):
    return f"http://localhost:{server.server_port}/"


@pytest.fixture(scope="module")
def browser():
    opened = Browser()
    yield opened
    opened.close()


@pytest.fixture
def desk(browser, page):
    browser.open("about:blank", 1200, 860)  # the page of the test before asks no more
    browser.errors.clear()
    browser.hosts.clear()
    browser.open(page, 1200, 860)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    return browser


def slide(browser, value):
    browser.value(
        f"(() => {{ const s = document.getElementById('slider'); s.value = {value};"
        " s.dispatchEvent(new Event('input')); })()"
    )


def text(browser, identity):
    return browser.value(f"document.getElementById('{identity}').textContent")


def press(browser, identity):
    browser.value(f"document.getElementById('{identity}').click()")


def until_it_asks_again(browser, watched):
    """Three answers from now: whatever was asked before has been drawn."""
    enough, deadline = watched.answered + 3, time.monotonic() + PATIENCE
    while watched.answered < enough:
        assert time.monotonic() < deadline, f"the page asks no more: {browser.errors}"
        time.sleep(0.1)


def drawn(browser, figure, attribute):
    found = f"[...document.querySelectorAll('#{figure} [{attribute}]')]"
    return browser.value(f"[...new Set({found}.map(e => e.getAttribute('{attribute}')))]")


def test_it_shows_the_papers_figures_with_bands_of_contexts(desk):
    assert set(drawn(desk, "weights", "data-task")) == set(TASKS)
    assert set(drawn(desk, "shares", "data-task")) == set(TASKS)
    assert set(drawn(desk, "contexts", "data-context")) == {"moving", "dialogue"}
    assert set(drawn(desk, "contexts", "fill")) - {"none"} == set(context_colors(["moving", "dialogue"]).values())
    assert text(desk, "headline").startswith("dialogue — ")
    assert text(desk, "state") == "live"


def test_axis_labels_match_the_grid_lines(desk, watched):
    def smaller(plans):
        for plan in plans:
            for node in plan["nodes"].values():
                node["capacity"] = 1.5
        return plans

    watched.alter_plans = smaller
    desk.call("Page.reload")
    desk.wait_for("document.querySelector('#shares text')?.textContent == '0'")
    assert desk.value("[...document.querySelectorAll('#shares text')].slice(0, 3).map(e => e.textContent)") == [
        *("0", "0.75", "1.5")
    ]


def test_it_says_why_a_task_has_its_share(desk):
    desk.value("document.querySelector('#tasks tbody tr').click()")
    desk.wait_for("document.querySelector('#why li')")
    assert "slam gets" in text(desk, "why")


def test_the_slider_goes_back_in_time_and_the_button_returns(desk):
    slide(desk, 700)
    assert text(desk, "state") == "back in time"
    assert text(desk, "headline").startswith("moving — ")
    assert "suspended" in text(desk, "tasks")
    assert desk.value("document.querySelectorAll('svg .cursor').length") == 3
    time.sleep(1.2)  # two more answers of the operator must not pull it back
    assert text(desk, "headline").startswith("moving — ")
    desk.value("document.getElementById('live').click()")
    assert text(desk, "state") == "live"


def test_moment_before_the_first_plan_does_not_freeze_the_page(desk, watched):
    desk.value("document.querySelector('#tasks tbody tr').click()")
    slide(desk, 0)
    assert "no plan" in text(desk, "headline")
    until_it_asks_again(desk, watched)
    press(desk, "live")
    assert (text(desk, "state"), desk.errors) == ("live", [])
    assert "slam gets" in text(desk, "why")


def test_a_task_that_an_older_plan_lacks_does_not_freeze_the_page(browser, page, watched):
    def without_signs(plans):
        for plan in plans[:-1]:
            del plan["tasks"]["signs"]
        return plans

    watched.alter_plans = without_signs
    browser.errors.clear()
    browser.open(page, 1200, 860)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    browser.value("[...document.querySelectorAll('#tasks tbody tr')].at(-1).click()")
    slide(browser, 700)
    assert "signs has no share in this plan" in text(browser, "why")
    until_it_asks_again(browser, watched)
    press(browser, "live")
    assert (text(browser, "state"), browser.errors) == ("live", [])


def test_duplicate_plan_does_not_clear_the_figures(desk, watched):
    [*_, last] = watched.plans("lab/robot", 0.0)
    watched.alter_plans = lambda plans: plans or [{**last, "published": last["published"] + 5e-5}]
    desk.value(
        "window.empty = 0; new MutationObserver(() => { empty += !document.querySelector('#weights [data-task]') })"
        ".observe(document.getElementById('weights'), { childList: true })"
    )
    until_it_asks_again(desk, watched)
    until_it_asks_again(desk, watched)
    assert desk.value("window.empty") == 0


def test_a_policy_that_is_paused_has_no_plan_in_force(desk, watched):
    watched.alter_boards = lambda boards: [{**board, "plan": None} for board in boards]
    until_it_asks_again(desk, watched)
    watched.happen({}, 12.0)
    until_it_asks_again(desk, watched)
    assert text(desk, "headline") == "no plan is in force"
    end = desk.value("document.querySelector('#shares .grid').x2.baseVal.value")
    drawn = "[...document.querySelectorAll('#shares [data-task]')].map(e => e.getBBox()).map(b => b.x + b.width)"
    assert desk.value(f"Math.max(...{drawn})") < end - 10
    slide(desk, 980)
    assert text(desk, "headline") == "no plan was in force at this moment, or none was recorded"


def test_an_error_shows_and_the_page_recovers(desk, watched):
    watched.alter_boards = lambda boards: [{**board, "streams": None} for board in boards]
    desk.wait_for("document.getElementById('state').textContent == 'error'")
    assert "TypeError" in text(desk, "problem")
    until_it_asks_again(desk, watched)
    watched.alter_boards = lambda boards: boards
    desk.wait_for("document.getElementById('state').textContent == 'live'")
    assert text(desk, "problem") == ""


def is_grey(browser):
    return "grayscale" in browser.value("getComputedStyle(document.querySelector('main')).filter")


def ago(browser):
    return float(text(browser, "moment").split(", ")[1].removesuffix(" s ago"))


@pytest.fixture
def offline(browser):
    def switch(*, off):
        browser.call(
            "Network.emulateNetworkConditions", offline=off, latency=0, downloadThroughput=-1, uploadThroughput=-1
        )

    yield switch
    switch(off=False)


def test_lost_operator_greys_the_page_and_shows_the_age(desk, offline):
    assert not is_grey(desk)
    assert "now" in text(desk, "weights")
    offline(off=True)
    desk.wait_for("document.getElementById('state').textContent == 'no answer'")
    assert is_grey(desk)
    desk.wait_for("/last update [2-9] s ago/.test(document.getElementById('source').textContent)")
    for figure in ("contexts", "weights", "shares"):
        assert "now" not in text(desk, figure), "the axis must not say now"
    assert text(desk, "moment") != "now"
    assert "no answer from localhost" in text(desk, "problem")
    slide(desk, 500)
    first = ago(desk)
    desk.wait_for(f"parseFloat(document.getElementById('moment').textContent.split(', ')[1]) >= {first + 2}")
    press(desk, "live")
    offline(off=False)
    desk.wait_for("document.getElementById('state').textContent == 'live'")
    assert not is_grey(desk)


def test_hanging_operator_is_not_shown_as_live(desk, watched):
    watched.hangs.set()
    desk.wait_for("document.getElementById('state').textContent == 'no answer'")
    assert is_grey(desk)
    assert "now" not in text(desk, "weights") + text(desk, "moment")
    watched.hangs.clear()
    desk.wait_for("document.getElementById('state').textContent == 'live'")
    assert not is_grey(desk)


def test_header_and_figures_agree_though_the_answer_gets_old_while_they_are_drawn(desk):
    state, axis = desk.value(
        "(() => { const { now } = performance, { setAttribute } = Element.prototype; let passed = 0;"
        "performance.now = () => now.call(performance) + passed;"
        "Element.prototype.setAttribute = function (...of) { passed = 4000; return setAttribute.apply(this, of); };"
        "dispatchEvent(new Event('resize'));"
        "Object.assign(performance, { now }); Object.assign(Element.prototype, { setAttribute });"
        "return [state.textContent, weights.textContent]; })()"
    )
    assert ("now" in axis) == (state == "live")


def test_age_counts_from_the_request_on_a_slow_link(desk, watched):
    """On a slow way an answer is old when it comes: made at once, it was under way for seconds."""
    desk.value(
        "window.states = []; new MutationObserver(() => states.push(state.textContent + ' ' + source.textContent))"
        ".observe(document.querySelector('header'), { childList: true, characterData: true, subtree: true })"
    )

    def slow(answer):
        time.sleep(4.0)
        return answer

    watched.alter_boards, watched.alter_plans = slow, slow
    until_it_asks_again(desk, watched)
    desk.value("states.length = 0")
    until_it_asks_again(desk, watched)
    states = desk.value("states")
    assert states
    assert not [one for one in states if one.startswith("live")]
    ages = [int(found[1]) for one in states if (found := re.search(r"last update (\d+) s ago", one))]
    assert min(ages) >= 8, "boards and plans took 4 s each"


def test_data_is_stale_after_the_machine_slept(desk, watched):
    """Its monotonic clock may have stood still."""
    watched.hangs.set()
    desk.value("window.exact = Date.now; Date.now = () => exact() + 3600e3")
    desk.wait_for("document.getElementById('state').textContent == 'no answer'")
    assert re.search(r"last update 36\d\d s ago", text(desk, "source"))
    desk.value("Date.now = exact")
    watched.hangs.clear()


def test_ended_pause_is_drawn_as_a_gap(desk, watched):
    watched.edit({}, mode="Paused")
    watched.edit({"robot/imu": {"speed": 0.0}}, mode="Enforce")
    desk.call("Page.reload")
    desk.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    gap = (
        "(() => { const d = document.querySelector('#weights [data-task=slam]').getAttribute('d');"
        " return (d.match(/M/g) || []).length; })()"
    )
    assert desk.value(gap) >= 2, "the line has a gap"
    slide(desk, 1000 - 1000 * 15 / 120)
    assert text(desk, "headline") == "no plan was in force at this moment, or none was recorded"


def test_recreated_policy_shows_no_earlier_history(desk, watched):
    desk.value("document.querySelector('#tasks tbody tr').click()")
    slide(desk, 700)
    assert "time=" in desk.value("location.hash")
    watched.recreate()
    desk.wait_for("document.getElementById('state').textContent == 'live'")
    until_it_asks_again(desk, watched)
    assert "time=" not in desk.value("location.hash"), "a link to what is not shown"
    assert desk.value("document.querySelectorAll('#contexts [data-context]').length") == 0
    begin = desk.value("document.querySelector('#shares .grid').x1.baseVal.value")
    drawn = "[...document.querySelectorAll('#shares [data-task]')].map(e => e.getBBox()).map(b => b.x)"
    assert desk.value(f"Math.min(...{drawn})") > begin + 100, "no plan of the other one"
    assert (text(desk, "state"), desk.errors) == ("live", [])


def test_a_clock_that_is_set_back_ends_the_look_back_in_time(desk, watched):
    """The moment that was shown has not come yet by the new clock."""
    slide(desk, 700)
    watched.alter_boards = lambda boards: [{**board, "now": board["now"] - 3600} for board in boards]
    watched.alter_plans = lambda plans: [{**plan, "published": plan["published"] - 3600} for plan in plans]
    desk.wait_for("document.getElementById('state').textContent == 'live'")
    assert (text(desk, "moment"), desk.errors) == ("now", [])
    assert "time=" not in desk.value("location.hash")


@pytest.mark.parametrize("name", ["constructor", "__proto__", "toString"])
def test_javascript_property_name_is_not_a_task(browser, page, name):
    browser.errors.clear()
    browser.open("about:blank", 1200, 860)
    browser.open(f"{page}#task={name}&window={name}", 1200, 860)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    assert text(browser, "why") == f"{name} has no share in this plan."
    assert (text(browser, "state"), browser.errors) == ("live", [])


def test_task_may_be_named_like_a_javascript_property(browser, page, watched):
    def renamed(found):
        return json.loads(json.dumps(found).replace('"slam"', '"constructor"'))

    watched.alter_boards = watched.alter_plans = renamed
    browser.errors.clear()
    browser.open(page, 1200, 860)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    assert "NaN" not in text(browser, "tasks")
    assert (text(browser, "state"), browser.errors) == ("live", [])


@pytest.mark.parametrize("time", ["1e12", "Infinity", "-5", "noon"])
def test_link_with_an_invalid_time_shows_now(browser, page, time):
    browser.open("about:blank", 1200, 860)
    browser.open(f"{page}#time={time}", 1200, 860)
    browser.wait_for("document.getElementById('state')?.textContent == 'live'")
    assert text(browser, "moment") == "now"


def test_tooltip_closes_after_another_tap(browser, page):
    browser.open(page, 390, 844, phone=True)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    browser.call("Emulation.setTouchEmulationEnabled", enabled=True)
    tap(browser, "shares")
    assert any(task in text(browser, "tip") for task in TASKS)
    assert not browser.value("document.getElementById('tip').hidden")
    tap(browser, "headline")
    assert browser.value("document.getElementById('tip').hidden")
    tap(browser, "weights")
    browser.wait_for("document.getElementById('tip').hidden")
    browser.call("Emulation.setTouchEmulationEnabled", enabled=False)


def tap(browser, identity):
    box = browser.value(
        f"(() => {{ document.getElementById('{identity}').scrollIntoView({{ block: 'center' }});"
        f" const b = document.getElementById('{identity}').getBoundingClientRect();"
        " return [b.left + b.width * 0.5, b.top + b.height * 0.6]; })()"
    )
    browser.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": box[0], "y": box[1]}])
    browser.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    time.sleep(0.5)  # the click that follows a tap


def test_a_tip_shows_what_is_under_the_pointer_now(desk, watched):
    """The figure goes on below a pointer that rests."""
    box = desk.value(
        "(() => { const b = document.getElementById('weights').getBoundingClientRect(); return [b.left, b.top]; })()"
    )
    desk.call("Input.dispatchMouseEvent", type="mouseMoved", x=box[0] + 300, y=box[1] + 60)
    before = text(desk, "tip")
    watched.happen({}, 20.0)
    until_it_asks_again(desk, watched)
    assert text(desk, "tip").split()[0] != before.split()[0], "another time"


@pytest.mark.parametrize("width", [360, 1200])
def test_focused_element_is_not_covered_by_the_header(browser, page, width):
    browser.open(page, width, 500, phone=width == 360)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    browser.value("scrollTo(0, document.body.scrollHeight)")
    browser.value("document.querySelector('#conditions summary').scrollIntoView()")
    browser.wait_for(
        "document.querySelector('#conditions summary').getBoundingClientRect().top"
        " >= document.querySelector('header').getBoundingClientRect().bottom"
    )


def test_deleted_policy_is_shown_as_not_found(desk, watched):
    watched.alter_boards = lambda boards: [{**board, "policy": "lab/other"} for board in boards]
    desk.wait_for("document.getElementById('state').textContent == 'not found'")
    assert desk.value("document.getElementById('policy').value") == "lab/robot", "nobody chose another one"
    assert is_grey(desk)
    assert "no lab/robot here: deleted, or" in text(desk, "source"), "a replica that stands by knows of no policy"
    watched.alter_boards = lambda _: []
    until_it_asks_again(desk, watched)
    assert (text(desk, "state"), is_grey(desk)) == ("not found", True)
    watched.alter_boards = lambda boards: boards
    desk.wait_for("document.getElementById('state').textContent == 'live'")


def test_switching_policies_hides_the_previous_data(desk, watched):
    watched.alter_boards = lambda boards: [*boards, *({**board, "policy": "lab/other"} for board in boards)]
    desk.wait_for("[...policy.options].some(option => option.value == 'lab/other')")
    watched.hangs.set()
    desk.value("policy.value = 'lab/other'; policy.dispatchEvent(new Event('change'))")
    assert "No data from lab/other" in text(desk, "headline")
    assert desk.value("document.querySelector('main').innerText") == text(desk, "headline")
    watched.hangs.clear()
    desk.wait_for("document.querySelector('#tasks').checkVisibility()")


def test_unrecorded_history_is_shown_as_unknown(desk):
    assert desk.value("document.querySelectorAll('#streams tbody tr').length") == 3
    slide(desk, 700)
    assert desk.value("document.querySelectorAll('#streams tbody tr, #conditions li').length") == 0
    assert "unknown" in text(desk, "unseen")
    assert "back in time" not in text(desk, "reactions")
    assert text(desk, "reactions") == "unknown"
    press(desk, "live")
    assert desk.value("document.querySelectorAll('#streams tbody tr').length") == 3


def test_history_shows_what_the_page_received_then(desk, watched):
    watched.happen({"robot/imu": {"speed": 0.4}}, 3.0)
    until_it_asks_again(desk, watched)
    before = text(desk, "streams")
    watched.happen({"robot/camera": {"signs": 3}}, 30.0)
    until_it_asks_again(desk, watched)
    assert text(desk, "streams") != before
    slide(desk, 1000 - 1000 * 30 / 120)
    assert text(desk, "streams") == before
    assert text(desk, "headline").startswith("moving")


def test_it_fits_on_a_phone(browser, page):
    browser.open(page, 390, 844, phone=True)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    assert browser.value("document.documentElement.scrollWidth") <= 390
    smallest = "Math.min(...[...document.querySelectorAll('select, button, input')].map(e => e.offsetHeight))"
    assert browser.value(smallest) >= 32, "a finger must hit it"


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1200, 360])
@pytest.mark.parametrize("moment", [1000, 700])
def test_axe_finds_no_violations(browser, page, scheme, width, moment):
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    browser.open(page, width, 860, phone=width == 360)
    browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 3")
    slide(browser, moment)
    browser.value("document.querySelector('#tasks tbody button').click()")
    browser.value(AXE.read_text(encoding="utf-8"))
    browser.value("axe.run().then(found => { window.found = found.violations })")
    browser.wait_for("window.found")
    found = browser.value("found.map(one => [one.id, one.nodes.map(node => node.html + node.failureSummary)])")
    assert found == []


def test_text_in_figures_stands_out_in_both_modes(browser, page):
    """axe leaves SVG out."""
    for scheme in ("light", "dark"):
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        browser.open(page, 1200, 860)
        browser.wait_for("document.querySelector('#contexts text')")
        ground = browser.value("getComputedStyle(document.querySelector('#contexts')).backgroundColor")
        inks = "[...new Set([...document.querySelectorAll('svg text')].map(e => getComputedStyle(e).fill))]"
        for ink in browser.value(inks):
            assert contrast(ink, ground) >= 4.5, (scheme, ink, ground)


def contrast(one, other):
    dark, light = sorted(luminance(color) for color in (one, other))
    return (light + 0.05) / (dark + 0.05)


def luminance(color):
    parts = [int(part) / 255 for part in re.findall(r"\d+", color)[:3]]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return sum(weight * part for weight, part in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def columns(browser):
    shown = "[...document.querySelectorAll('#tasks thead th')].filter(e => !e.hidden).map(e => e.textContent)"
    return browser.value(shown)


def test_empty_columns_are_hidden(desk, watched):
    assert columns(desk) == ["task", "weight", "share", "limit", "because"]
    watched.alter_boards = lambda boards: [
        {**board, "containers": [{**one, "use": 0.1, "throttled": 0.2} for one in board["containers"]]}
        for board in boards
    ]
    until_it_asks_again(desk, watched)
    assert columns(desk) == ["task", "weight", "share", "limit", "use", "throttled", "because"]
    slide(desk, 500)
    assert columns(desk) == ["task", "weight", "share", "because"]
    press(desk, "live")


def test_the_keyboard_reaches_a_task_and_keeps_it(desk, watched):
    desk.value("document.querySelector('#tasks tbody button').focus()")
    desk.call("Input.dispatchKeyEvent", type="keyDown", key="Enter", code="Enter", text="\r", windowsVirtualKeyCode=13)
    desk.call("Input.dispatchKeyEvent", type="keyUp", key="Enter", code="Enter", windowsVirtualKeyCode=13)
    assert desk.value("document.activeElement.getAttribute('aria-pressed')") == "true"
    desk.value("window.row = document.querySelector('#tasks tbody tr')")
    watched.happen({"robot/imu": {"speed": 0.4}}, 1.0)
    until_it_asks_again(desk, watched)
    assert desk.value("row.isConnected && document.activeElement === row.querySelector('button')")


def test_a_condition_says_why_without_a_pointer(desk, watched):
    watched.alter_boards = lambda boards: [
        {
            **board,
            "conditions": [{"type": "Connected", "status": "False", "reason": "NoRouter", "message": "no router"}],
        }
        for board in boards
    ]
    desk.wait_for("document.querySelector('#conditions li.bad')")
    assert desk.value("document.querySelector('#conditions details').open")
    assert "no router" in desk.value("document.querySelector('#conditions').innerText")


def test_with_reduced_motion_the_figures_stand_still(browser, page, watched):
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
    browser.open(page, 1200, 860)
    browser.wait_for("document.querySelector('#weights path')")
    watched.happen({}, 5.2 - watched.boards()[0]["now"] % 5)
    until_it_asks_again(browser, watched)
    begin = "document.querySelector('#weights [data-task]').getAttribute('d').split(' ')[0]"
    before = browser.value(begin)
    watched.happen({}, 2.0)
    until_it_asks_again(browser, watched)
    assert browser.value(begin) == before
    watched.happen({}, 4.0)
    until_it_asks_again(browser, watched)
    assert browser.value(begin) != before
    browser.call("Emulation.setEmulatedMedia", features=[])


def test_a_click_in_a_figure_selects_that_moment_and_the_link_holds_it(desk):
    box = desk.value(
        "(() => { const b = document.getElementById('shares').getBoundingClientRect();"
        " return [b.left, b.top, b.width, b.height]; })()"
    )
    place = {"x": box[0] + box[2] * 0.6, "y": box[1] + box[3] * 0.6, "button": "left", "clickCount": 1}
    for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
        desk.call("Input.dispatchMouseEvent", type=kind, **place)
    assert text(desk, "state") == "back in time"
    cursor = desk.value("document.querySelector('#shares .cursor').getBoundingClientRect().left")
    assert cursor == pytest.approx(place["x"], abs=1.5)
    tip = desk.value("document.getElementById('tip').hidden ? '' : document.getElementById('tip').textContent")
    assert any(task in tip for task in TASKS)
    desk.value("document.querySelector('#tasks tbody button').click()")
    headline, address = text(desk, "headline"), desk.value("location.href")
    desk.open("about:blank", 1200, 860)
    desk.open(address, 1200, 860)
    desk.wait_for(
        "document.getElementById('state')?.textContent == 'back in time' && document.querySelector('#why li')"
    )
    assert text(desk, "headline") == headline


def test_the_sliders_thumb_is_below_the_cursor(desk):
    for value in (0, 250, 999):
        slide(desk, value)
        box = desk.value(
            "(() => { const b = document.getElementById('slider').getBoundingClientRect();"
            " return [b.left, b.width]; })()"
        )
        for figure in ("contexts", "weights", "shares"):
            cursor = desk.value(f"document.querySelector('#{figure} .cursor').getBoundingClientRect().left")
            assert cursor == pytest.approx(box[0] + 8 + value / 1000 * (box[1] - 16), abs=1.5)
    press(desk, "live")


@pytest.mark.parametrize("width", [360, 1200])
def test_twenty_tasks_have_their_own_colours_and_labels_and_nothing_is_cut_off(browser, width):
    with pytest.MonkeyPatch.context() as patch:
        operator = run(patch, *many(20))
        server = PageServer(0, Disturbed(operator))
        server.start()
        browser.open(f"http://localhost:{server.server_port}/", width, 860, phone=width == 360)
        browser.wait_for("document.querySelectorAll('#tasks tbody tr').length == 20")
        colors = browser.value("[...document.querySelectorAll('#shares [data-task]')].map(e => e.getAttribute('fill'))")
        assert sorted(colors) == sorted(task_colors(f"task-{number:02}" for number in range(20)).values())
        for figure in ("weights", "shares"):
            rows = browser.value(
                f"[...document.querySelectorAll('#{figure} .name')].map(e => Number(e.getAttribute('y')))"
            )
            assert len(rows) == 20
            assert min(b - a for a, b in pairwise(sorted(rows))) >= 10, "labels lie on each other"
        cut = (
            "[...document.querySelectorAll('main *, header *')].filter(e => { const b = e.getBoundingClientRect();"
            " return getComputedStyle(e).clipPath === 'none' && !e.closest('thead') && b.width &&"
            " (b.right > innerWidth + 1 || b.left < -1); }).map(e => e.outerHTML.slice(0, 80))"
        )
        assert browser.value(cut) == []
        server.close()


def test_page_loads_only_from_its_server_without_errors(desk, page):
    assert desk.hosts <= {page.rstrip("/"), f"{page}api", "data:"}
    assert desk.errors == []
