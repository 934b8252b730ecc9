"use strict";
// The live page: asks the operator twice a second, keeps the plans of the last minutes, and draws them as steps.

const COLORS = ["#2a6f97", "#e07a3f", "#5b8e55", "#8d5b8c", "#c2a83e", "#4f9da6", "#b5495b", "#6c757d"];
const BANDS = ["#f6c453", "#9fd3c7", "#d5b6e8", "#f2a6a6", "#b8d8f0", "#d9d9a5"];
const KEPT = 300; // seconds, as long as the operator's own recorder
const PERIOD = 500; // ms between two questions
const LEFT = 44; // pixels beside the figures, for their axes

const at = (id) => document.getElementById(id);
const view = { policy: "", boards: [], plans: [], moment: null, task: "", away: false };

async function ask(path) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
  return answer.json();
}

const chosen = () => view.boards.find((board) => board.policy === view.policy);
const span = () => Number(at("window").value);

async function refresh() {
  try {
    view.boards = await ask("api/boards");
    if (!chosen()) choose(view.boards.length ? view.boards[0].policy : "");
    if (view.policy) await refreshPlans();
    view.away = false;
  } catch (error) {
    view.away = true; // the operator restarts, or the port-forward ended: what was heard stays on the screen
  }
  draw();
}

async function refreshPlans() {
  const asked = view.policy;
  const last = view.plans.length ? view.plans[view.plans.length - 1].published : 0;
  const news = await ask(`api/plans?policy=${encodeURIComponent(asked)}&since=${last}`);
  if (asked !== view.policy) return;
  view.plans.push(...news);
  const oldest = chosen().now - KEPT;
  while (view.plans.length > 1 && view.plans[1].published < oldest) view.plans.shift();
}

function choose(policy) {
  Object.assign(view, { policy, plans: [], moment: null, task: "" });
  at("slider").value = 1000;
}

// What was in force at a moment: the last plan before it.
const planAt = (moment) => view.plans.filter((plan) => plan.published <= moment).pop() || null;

function element(name, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

function node(name, text, className) {
  const made = document.createElement(name);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

// A figure's frame: where a time and a value are, and a cleared <svg> to draw on.
function figure(id, height, end, top) {
  const svg = at(id), width = svg.clientWidth || 600, begin = end - span();
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.setAttribute("height", height);
  svg.replaceChildren();
  const x = (time) => LEFT + (Math.max(begin, Math.min(end, time)) - begin) / (end - begin) * (width - LEFT - 6);
  const y = (value) => height - 16 - (value / top) * (height - 24);
  return { svg, width, height, begin, end, x, y };
}

function axes(f, ticks, label) {
  for (const tick of ticks) {
    f.svg.append(element("line", { class: "grid", x1: LEFT, x2: f.width - 6, y1: f.y(tick), y2: f.y(tick) }));
    f.svg.append(element("text", { x: LEFT - 5, y: f.y(tick) + 4, "text-anchor": "end" }, label(tick)));
  }
  timeAxis(f);
}

function timeAxis(f) {
  const step = span() / 4;
  for (let i = 0; i <= 4; i += 1) {
    const anchor = i === 0 ? "start" : i === 4 ? "end" : "middle";
    f.svg.append(element("text", { x: f.x(f.begin + i * step), y: f.height - 3, "text-anchor": anchor },
      i === 4 ? "now" : `-${Math.round(span() - i * step)} s`));
  }
}

function cursor(f) {
  if (view.moment === null) return;
  f.svg.append(element("line", { class: "cursor", x1: f.x(view.moment), x2: f.x(view.moment), y1: 2, y2: f.height - 14 }));
}

// Steps of one value per plan: [from, to, value].
function steps(end, value) {
  return view.plans.map((plan, i) =>
    [plan.published, i + 1 < view.plans.length ? view.plans[i + 1].published : end, value(plan)]);
}

const tasksOf = () => [...new Set(view.plans.flatMap((plan) => Object.keys(plan.tasks)))];
const colorOf = (task) => COLORS[tasksOf().indexOf(task) % COLORS.length];

function drawContexts(end) {
  const names = Object.keys(chosen().contexts), lane = 20;
  const f = figure("contexts", Math.max(1, names.length) * lane + 18, end, 1);
  names.forEach((name, i) => {
    for (const [from, to, holds] of steps(end, (plan) => plan.contexts.includes(name))) {
      if (!holds || to < f.begin) continue;
      f.svg.append(element("rect", { "data-context": name, x: f.x(from), y: i * lane + 3, height: lane - 6,
        width: Math.max(1, f.x(to) - f.x(from)), fill: BANDS[i % BANDS.length] }));
    }
    f.svg.append(element("text", { x: LEFT + 4, y: i * lane + 14 }, name));
  });
  timeAxis(f);
  cursor(f);
}

function drawWeights(end) {
  const f = figure("weights", 150, end, 1);
  axes(f, [0, 0.5, 1], (tick) => `${tick * 100} %`);
  const sum = (plan) => leaves(plan).reduce((total, task) => total + plan.tasks[task].weight, 0);
  for (const task of tasksOf()) {
    let path = "";
    for (const [from, to, value] of steps(end, (plan) => weight(plan, task, sum(plan)))) {
      if (value === null || to < f.begin) continue;
      path += `${path ? "L" : "M"}${f.x(from)} ${f.y(value)}L${f.x(to)} ${f.y(value)}`;
    }
    if (path) f.svg.append(element("path", { "data-task": task, d: path, fill: "none", stroke: colorOf(task), "stroke-width": 2 }));
  }
  cursor(f);
}

// Tasks that have a share of their own: those with subtasks only pass their weight on.
const leaves = (plan) => {
  const own = new Set(Object.values(plan.nodes).flatMap((node) => Object.keys(node.tasks)));
  return Object.keys(plan.tasks).filter((task) => own.has(task));
};
const weight = (plan, task, sum) => (leaves(plan).includes(task) && sum ? plan.tasks[task].weight / sum : null);

function drawShares(end) {
  const capacity = (plan) => Object.values(plan.nodes).reduce((total, node) => total + node.capacity, 0);
  const top = Math.max(0.001, ...view.plans.map(capacity));
  const f = figure("shares", 190, end, top);
  axes(f, [0, top / 2, top], (tick) => tick.toFixed(top < 1 ? 2 : 1));
  const base = view.plans.map(() => 0);
  for (const task of tasksOf()) {
    steps(end, (plan) => (leaves(plan).includes(task) ? plan.tasks[task].share : 0)).forEach(([from, to, share], i) => {
      const foot = base[i];
      base[i] += share;
      if (!share || to < f.begin) return;
      f.svg.append(element("rect", { "data-task": task, x: f.x(from), y: f.y(foot + share), fill: colorOf(task),
        width: Math.max(0.5, f.x(to) - f.x(from)), height: Math.max(0.5, f.y(foot) - f.y(foot + share)) }));
    });
  }
  cursor(f);
}

const cores = (value) => (value === null || value === undefined ? "-" : `${Math.round(value * 1000)}m`);
const seconds = (value) => (value < 1 ? `${Math.round(value * 1000)} ms` : `${value.toFixed(1)} s`);
const sum = (values) => values.every((value) => value === null) ? null : values.reduce((a, b) => a + (b || 0), 0);

function drawTasks(plan, now) {
  const rows = Object.entries(plan ? plan.tasks : {}).map(([name, task]) => {
    const own = now ? chosen().containers.filter((container) => container.task === name) : [];
    const shown = [name, String(Math.round(task.weight * 100) / 100), cores(task.share) + (task.suspended ? " (suspended)" : ""),
      own.length ? cores(sum(own.map((one) => one.limit))) : "-", own.length ? cores(sum(own.map((one) => one.use))) : "-",
      own.some((one) => one.throttled !== null) ? `${Math.round(Math.max(...own.map((one) => one.throttled || 0)) * 100)} %` : "-",
      task.because];
    const row = node("tr", "", name === view.task ? "chosen" : "");
    row.append(...shown.map((text) => node("td", text)));
    row.addEventListener("click", () => { view.task = name === view.task ? "" : name; draw(); });
    return row;
  });
  at("tasks").tBodies[0].replaceChildren(...rows);
  const why = !view.task ? [] : now ? chosen().why[view.task] || [] : [plan.tasks[view.task].because];
  at("why").replaceChildren(...why.map((sentence) => node("li", sentence)));
}

function drawStreams(board) {
  const rows = Object.entries(board.streams).map(([name, stream]) => {
    const state = stream.silent ? "silent" : stream.age === null ? "not heard yet" : "heard";
    const row = node("tr", "", stream.silent ? "bad" : "");
    row.append(...[name, stream.age === null ? "-" : seconds(stream.age), String(stream.samples), state, stream.key]
      .map((text) => node("td", text)));
    return row;
  });
  at("streams").tBodies[0].replaceChildren(...rows);
}

function drawHeader(board, plan, now) {
  const state = at("state");
  state.textContent = view.away ? "no answer" : now ? "live" : "back in time";
  state.className = view.away ? "away" : now ? "" : "past";
  const options = view.boards.map((one) => one.policy);
  const select = at("policy");
  if ([...select.options].map((option) => option.value).join() !== options.join()) {
    select.replaceChildren(...options.map((name) => new Option(name, name)));
  }
  select.value = view.policy;
  const contexts = plan && plan.contexts.length ? plan.contexts.join(", ") : "no context";
  at("headline").textContent = plan ? `${contexts} — ${plan.cause}` : "no plan yet";
  at("cause").textContent = plan ? `plan ${plan.sequence}${plan.mode === "Enforce" ? "" : `, ${plan.mode}`}` : "";
  at("conditions").replaceChildren(...board.conditions.map((one) => {
    const item = node("li", one.type, one.status === "True" ? "" : "bad");
    item.title = one.message || one.reason;
    return item;
  }));
  at("moment").textContent = now ? "now" : `-${(board.now - view.moment).toFixed(1)} s`;
}

function draw() {
  const board = chosen();
  if (!board) {
    at("headline").textContent = view.away ? "The operator does not answer." : "There is no policy.";
    at("state").textContent = view.away ? "no answer" : "live";
    at("state").className = view.away ? "away" : "";
    return;
  }
  const now = view.moment === null, plan = now ? board.plan : planAt(view.moment);
  drawHeader(board, plan, now);
  drawContexts(board.now);
  drawWeights(board.now);
  drawShares(board.now);
  at("legend").replaceChildren(...tasksOf().map((task) => {
    const item = node("li", task), mark = document.createElement("i");
    mark.style.background = colorOf(task);
    item.prepend(mark);
    return item;
  }));
  drawTasks(plan, now);
  drawStreams(board);
  const r = board.reactions;
  at("reactions").textContent = r ? `median ${seconds(r.median)}, worst ${seconds(r.worst)}, last ${seconds(r.last)} of the latest ${r.count}` : "none yet";
}

at("policy").addEventListener("change", (event) => { choose(event.target.value); refresh(); });
at("window").addEventListener("change", () => { view.moment = null; at("slider").value = 1000; draw(); });
at("slider").addEventListener("input", (event) => {
  const part = Number(event.target.value) / 1000, board = chosen();
  view.moment = part >= 1 || !board ? null : board.now - (1 - part) * span();
  draw();
});
at("live").addEventListener("click", () => { view.moment = null; at("slider").value = 1000; draw(); });
window.addEventListener("resize", draw);

(async function follow() {
  await refresh();
  setTimeout(follow, document.hidden ? 4 * PERIOD : PERIOD);
})();
