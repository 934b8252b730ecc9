// The live page: asks the operator twice a second, keeps what it heard of the last minutes, and shows one moment of it.
import { drawFigures, valueAt } from "./figures.js";
import { drawConditions, drawStreams, drawTasks, reactions, write } from "./tables.js";

const KEPT = 300; // seconds, as long as the operator's own recorder
const MOST = 5000; // plans, in case one moment stays open for hours
const PERIOD = 500; // ms between two questions
const PATIENCE = 5000; // ms for an answer
const FRESH = 3; // seconds after the question for which its answer counts as current
const TAPPED = 4000; // ms for which a tip stays after a tap
const ELSEWHERE = "this operator is starting or on standby"; // then it knows of no policy
const SEEN = 2.5; // seconds for which a board that was seen stands for what was then

const at = (id) => document.getElementById(id);
const view = { state: "", policy: "", task: "", moment: null, end: null, boards: [], board: null, plans: [], seen: [], colors: bare({}),
  heard: null, kept: null, problem: "", broken: "" };
const calm = matchMedia("(prefers-reduced-motion: reduce)");

async function ask(path) {
  const answer = await fetch(path, { signal: AbortSignal.timeout(PATIENCE) }).catch(() => {
    throw new Error(`no answer from ${location.host}: check that the operator and the port-forward to it are running`);
  });
  if (!answer.ok) throw new Error(`${path.split("?")[0]}: ${answer.status} ${(await answer.text()).trim()}`);
  return JSON.parse(await answer.text(), (_, value) => bare(value));
}

// Names are people's: without a prototype, "constructor" is in an object only if the operator says so.
function bare(value) {
  return value && typeof value === "object" && !Array.isArray(value) ? Object.setPrototypeOf(value, null) : value;
}

const span = () => Number(at("window").value);
const end = () => view.end ?? (calm.matches ? Math.ceil(view.board.now / 5) * 5 : view.board.now);
const tick = () => [performance.now(), Date.now()]; // the first may stand still while a machine sleeps, the second may be set
const since = ([steady, wall]) => Math.max(performance.now() - steady, Date.now() - wall) / 1000;
const here = () => view.boards.some((board) => board.policy === view.policy);
const clock = (time) => new Date(time * 1000).toTimeString().slice(0, 8);

async function refresh() {
  const asked = tick(); // what the operator answers is no older than that, however long the answer was under way
  try {
    const boards = await ask("api/boards");
    if (!view.policy && boards.length) view.policy = boards[0].policy;
    await take(boards, asked);
    if (overtaken(asked)) return;
    view.heard = asked;
    view.problem = "";
  } catch (error) {
    if (overtaken(asked)) return;
    view.problem = error.message; // the operator restarts, or the port-forward ended: what was heard stays, in grey
  }
  draw();
}

// Two questions may be under way, and the later one answered first: then the other's answer is old.
const overtaken = (asked) => view.heard !== null && asked[0] < view.heard[0];

async function take(boards, asked) {
  const { policy } = view, board = boards.find((one) => one.policy === policy);
  if (board) {
    const last = view.plans.at(-1), end = board.plan ? null : last?.until; // a paused policy's last plan has ended once
    const news = await ask(`api/plans?policy=${encodeURIComponent(policy)}&since=${end ?? last?.published ?? 0}`);
    if (policy !== view.policy || overtaken(asked)) return;
    keep(board, news, asked);
  }
  if (!overtaken(asked)) view.boards = boards;
}

const same = (a, b) => a.run === b.run && a.sequence === b.sequence && a.edition === b.edition;

function keep(board, news, asked) {
  const { moment } = view;
  const again = view.board && board.uid !== view.board.uid; // made again under its name: the past is another policy's
  if (again || view.board && board.now < view.board.now - 1) { // or the operator's clock was set: moments mean others now
    Object.assign(view, { plans: [], seen: [], moment: null, end: null });
  } else for (const one of news) { // two questions may be under way, and a plan that is known may have ended
    const known = view.plans.find((plan) => same(plan, one));
    if (known) known.until = one.until;
    else view.plans.push(one);
  }
  const last = view.plans.at(-1); // the operator was started while the policy was paused: it knows of no plan that ended
  if (last && !board.plan) last.until ??= board.now;
  if (!view.seen.length || board.now - view.seen.at(-1).now >= 1) view.seen.push(board);
  const oldest = Math.min(board.now, view.end ?? Infinity) - KEPT;
  while (view.plans.length > 1 && (view.plans[1].published < oldest || view.plans.length > MOST)) view.plans.shift();
  while (view.seen[0].now < board.now - KEPT) view.seen.shift();
  Object.assign(view.colors, board.colors);
  Object.assign(view, { board, kept: asked });
  if (view.moment !== null && view.end === null) look(view.moment);
  if (view.moment !== moment) address();
}

function choose(policy) {
  Object.assign(view, { policy, board: null, kept: null, plans: [], seen: [], moment: null, end: null, task: "" });
}

// Show one moment, with the figures standing still; null is now.
function look(moment) {
  view.moment = moment;
  if (moment === null || !view.board) return Object.assign(view, { end: null });
  if (moment > view.board.now) return look(null); // it has not come yet
  view.end ??= end();
  if (moment < view.end - span() || moment > view.end) view.end = Math.min(view.board.now, moment + span() / 2);
}

const planAt = (moment) => {
  const plan = view.plans.findLast((one) => one.published <= moment);
  return plan && moment < (plan.until ?? Infinity) ? plan : null;
};
const boardAt = (moment) => view.seen.findLast((board) => board.now <= moment && moment - board.now < SEEN) || null;

function draw() {
  view.broken = "";
  view.state = state(); // once: an answer may get old while the figures are drawn
  try {
    drawMoment();
  } catch (error) {
    view.broken = `This page failed: ${error}`;
    view.state = state();
  }
  drawState();
}

// How much of what is on the screen is current.
function state() {
  if (view.broken) return "error";
  if (view.problem || view.heard !== null && since(view.heard) > FRESH) return "no answer";
  if (view.heard === null) return "connecting";
  if (!view.policy) return "no policy";
  return !here() ? "not found" : view.moment !== null ? "back in time" : "live";
}

// Works whatever else fails, and without an answer.
function drawState() {
  write(at("state"), view.state);
  document.body.className = view.state.replaceAll(" ", "-");
  const last = view.heard === null ? "" : `last update ${Math.round(since(view.kept ?? view.heard))} s ago`;
  const gone = view.state === "not found" ? `no ${view.policy} here: deleted, or ${ELSEWHERE}` : "";
  write(at("source"), [gone, last, `from ${location.host}`].filter(Boolean).join(", "));
  write(at("problem"), view.broken || view.problem);
}

function drawMoment() {
  drawChoice();
  const past = view.moment !== null, latest = view.board;
  document.querySelector("main").className = latest ? "" : "empty"; // nothing of the policy before, under another name
  if (!latest) {
    return write(at("headline"), view.policy ? `No data from ${view.policy} yet` : `No policy here: none exists, or ${ELSEWHERE}.`);
  }
  const plan = past ? planAt(view.moment) : latest.plan, board = past ? boardAt(view.moment) : latest;
  const current = view.state === "live";
  drawHeadline(plan, past, current);
  write(at("unseen"), board ? "" : "Streams, conditions, limits, use and reactions of this moment are unknown: " +
    "the operator records plans only, and this page was not open.");
  drawFigures({ ...view, end: end(), begin: end() - span(), until: Math.min(end(), latest.now), clock,
    contexts: Object.keys(latest.contexts), relative: current && !calm.matches, span: span() });
  drawConditions(board ? board.conditions : []);
  drawTasks(plan, board, view.task, pick);
  const task = view.task && plan && plan.tasks[view.task];
  const why = !view.task ? [] : !task ? [`${view.task} has no share in this plan.`]
    : past ? [task.because] : latest.why[view.task] || [task.because];
  at("why").replaceChildren(...why.map((sentence) => Object.assign(document.createElement("li"), { textContent: sentence })));
  if (!at("tip").hidden) drawTip(view.pointer); // the figures go on below a pointer that rests
  drawStreams(board ? board.streams : {});
  write(at("reactions"), board ? reactions(board.reactions) : "unknown");
}

function drawChoice() {
  const names = view.boards.map((board) => board.policy), select = at("policy");
  if (view.policy && !names.includes(view.policy)) names.push(view.policy);
  if ([...select.options].map((option) => option.value).join() !== names.join()) {
    select.replaceChildren(...names.map((name) => new Option(name, name)));
  }
  select.value = view.policy;
}

function drawHeadline(plan, past, current) {
  const contexts = plan && plan.contexts.length ? plan.contexts.join(", ") : "no context";
  write(at("headline"), plan ? `${contexts} — ${plan.cause}` : past
    ? "no plan was in force at this moment, or none was recorded" : "no plan is in force");
  write(at("cause"), plan ? `plan ${plan.sequence}${plan.mode === "Enforce" ? "" : `, ${plan.mode}`}` : "");
  const moment = past ? `${clock(view.moment)}, ${(view.board.now + since(view.kept) - view.moment).toFixed(1)} s ago`
    : current ? "now" : clock(view.board.now);
  write(at("moment"), moment);
  at("slider").value = past ? 1000 * (view.moment - end() + span()) / span() : 1000;
  at("slider").setAttribute("aria-valuetext", moment);
}

function pick(task) {
  view.task = task === view.task ? "" : task;
  link();
}

// What is shown, as a link: policy, task, moment and window.
function address() {
  const shown = { policy: view.policy, window: at("window").value, task: view.task, time: view.moment?.toFixed(2) };
  const parts = new URLSearchParams(Object.entries(shown).filter(([, value]) => value));
  history.replaceState(null, "", `#${parts}`);
}

function link() {
  address();
  draw();
}

function follow() {
  const parts = new URLSearchParams(location.hash.slice(1)), time = Number(parts.get("time"));
  if (parts.get("policy") && parts.get("policy") !== view.policy) choose(parts.get("policy"));
  if ([...at("window").options].some((option) => option.value === parts.get("window"))) at("window").value = parts.get("window");
  view.task = parts.get("task") || "";
  look(time > 0 ? time : null);
}

function show(moment) {
  look(moment);
  link();
}

at("policy").addEventListener("change", (event) => { choose(event.target.value); link(); refresh(); });
at("window").addEventListener("change", () => show(view.moment));
at("live").addEventListener("click", () => show(null));
at("slider").addEventListener("input", (event) => {
  const part = Number(event.target.value) / 1000;
  if (view.board) show(part >= 1 ? null : end() - (1 - part) * span());
});
for (const id of ["contexts", "weights", "shares"]) {
  at(id).addEventListener("click", (event) => { if (view.board) show(valueAt(point(event)).time); drawTip(view.pointer); });
  at(id).addEventListener("pointermove", (event) => drawTip(point(event)));
  at(id).addEventListener("pointerleave", hideTip);
}
addEventListener("pointerdown", hideTip);

// Where the pointer is; a finger does not stay there.
function point({ currentTarget: { id }, clientX, clientY, pointerType }) {
  clearTimeout(view.tapped);
  if (pointerType !== "mouse") view.tapped = setTimeout(hideTip, TAPPED);
  return view.pointer = { id, clientX, clientY };
}

function hideTip() {
  at("tip").hidden = true;
}

function drawTip(event) {
  if (!view.board) return;
  const { time, text } = valueAt(event), tip = at("tip"), frame = at("figures").getBoundingClientRect();
  tip.textContent = `${clock(time)} ${text}`;
  tip.hidden = false;
  tip.style.left = `${Math.max(0, Math.min(event.clientX - frame.left + 12, frame.width - tip.offsetWidth))}px`;
  tip.style.top = `${event.clientY - frame.top - tip.offsetHeight - 8}px`;
}

const header = document.querySelector("header"); // it covers what is scrolled to the top
new ResizeObserver(() => { document.documentElement.style.scrollPaddingTop = `${header.offsetHeight + 8}px`; }).observe(header);
addEventListener("resize", draw);
addEventListener("hashchange", () => { follow(); refresh(); });
document.addEventListener("visibilitychange", () => { if (!document.hidden) refresh(); });
setInterval(() => (state() === view.state ? drawState() : draw()), PERIOD);
follow();
(function poll() {
  refresh().finally(() => setTimeout(poll, document.hidden ? 4 * PERIOD : PERIOD));
})();
