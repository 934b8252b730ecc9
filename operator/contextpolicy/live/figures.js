// The figures: contexts as lanes, weights as lines, shares as a stack, over one stretch of time.
const LEFT = 44; // pixels beside the figures, for their axes
const LINE = 13; // pixels from one label to the next
const GRAY = "#808a94"; // what the policy no longer has
const figures = {}; // by id: what was drawn last, for the pointer

function element(name, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

export function drawFigures(given) {
  const plans = given.plans.filter((plan, i) => (given.plans[i + 1]?.published ?? Infinity) > given.begin && plan.published < given.end)
    .map((plan) => ({ plan, own: leaves(plan) }));
  plans.forEach((one, i) => Object.assign(one, { from: one.plan.published,
    to: Math.min(one.plan.until ?? Infinity, plans[i + 1]?.plan.published ?? given.until),
    sum: [...one.own].reduce((sum, task) => sum + one.plan.tasks[task].weight, 0) }));
  const tasks = [...new Set(plans.toReversed().flatMap((one) => [...one.own]))];
  const lanes = [...new Set([...given.contexts, ...plans.flatMap((one) => one.plan.contexts)])];
  const longest = Math.max(0, ...[...tasks, ...lanes].map((name) => name.length));
  const all = { ...given, plans, tasks, lanes, right: 20 + 6.5 * longest };
  drawContexts(all);
  drawWeights(all);
  drawShares(all);
}

// Tasks that have a share of their own: those with subtasks only pass their weight on.
function leaves(plan) {
  const own = new Set(Object.values(plan.nodes).flatMap((node) => Object.keys(node.tasks)));
  return new Set(Object.keys(plan.tasks).filter((task) => own.has(task)));
}

// A figure's frame: where a time and a value are, and a cleared <svg> to draw on.
function figure(id, height, top, all) {
  const svg = document.getElementById(id), width = svg.clientWidth || 600, { begin, end } = all;
  const right = width - Math.min(all.right, 0.3 * width);
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.setAttribute("height", height);
  svg.replaceChildren();
  const x = (time) => LEFT + (Math.max(begin, Math.min(end, time)) - begin) / (end - begin) * (right - LEFT);
  const y = (value) => height - 18 - (value / top) * (height - 26);
  const time = (pixel) => begin + (Math.max(LEFT, Math.min(right, pixel)) - LEFT) / (right - LEFT) * (end - begin);
  const value = (pixel) => (height - 18 - pixel) / (height - 26) * top;
  const slider = document.getElementById("slider"); // its thumb, 16 pixels wide, is below the cursor
  slider.style.marginLeft = `${LEFT - 8}px`;
  slider.style.width = `${right - LEFT + 16}px`;
  return figures[id] = { svg, width, height, right, top, all, x, y, time, value };
}

function axes(f, ticks, label) {
  for (const tick of ticks) {
    f.svg.append(element("line", { class: "grid", x1: LEFT, x2: f.right, y1: f.y(tick), y2: f.y(tick) }));
    f.svg.append(element("text", { x: LEFT - 5, y: f.y(tick) + 4, "text-anchor": "end" }, label(tick)));
  }
}

function finish(f) {
  const { begin, span, relative, clock, moment } = f.all, parts = f.right - LEFT < 300 ? 2 : 4;
  for (let i = 0; i <= parts; i += 1) {
    const time = begin + span * i / parts, back = span - span * i / parts;
    f.svg.append(element("text", { x: f.x(time), y: f.height - 4, "text-anchor": ["start", "middle", "end"][i ? i < parts ? 1 : 2 : 0] },
      !relative ? clock(time) : back ? `-${Math.round(back)} s` : "now"));
  }
  if (moment !== null) {
    f.svg.append(element("line", { class: "cursor", x1: f.x(moment), x2: f.x(moment), y1: 2, y2: f.height - 16 }));
  }
}

// Names beside the ends of what they name, none over another.
function labels(f, ends) {
  const room = Math.floor((f.width - f.right - 16) / 6.3);
  ends.sort((a, b) => a.y - b.y);
  ends.forEach((one, i) => { one.at = Math.max(one.y, i ? ends[i - 1].at + LINE : 8); });
  ends.forEach((_, i) => {
    const one = ends.at(-1 - i);
    one.at = Math.min(one.at, i ? ends.at(-i).at - LINE : f.height - 20);
  });
  for (const { name, y, at, color } of ends) {
    f.svg.append(element("path", { d: `M${f.right + 1} ${y}L${f.right + 8} ${at}`, stroke: color, "stroke-width": 2 }));
    const text = element("text", { class: "name", x: f.right + 11, y: at + 4 },
      name.length > room ? `${name.slice(0, room - 1)}…` : name);
    text.append(element("title", {}, name));
    f.svg.append(text);
  }
}

function drawContexts(all) {
  const lane = 18, f = figure("contexts", Math.max(1, all.lanes.length) * lane + 26, 1, all);
  all.lanes.forEach((name, i) => {
    for (const { plan, from, to } of all.plans) {
      if (plan.contexts.includes(name)) {
        f.svg.append(element("rect", { "data-context": name, x: f.x(from), y: i * lane + 4, height: lane - 5,
          width: Math.max(1, f.x(to) - f.x(from)), fill: all.board.contexts[name]?.color || GRAY }));
      }
    }
  });
  labels(f, all.lanes.map((name, i) => ({ name, y: i * lane + 10, color: "none" })));
  f.pick = (one, pixel) => {
    const name = all.lanes[Math.floor(pixel / lane)];
    return !name || !one ? "" : `${name} ${one.plan.contexts.includes(name) ? "holds" : "does not hold"}`;
  };
  finish(f);
}

const color = (all, task) => all.colors[task] || GRAY;
const part = (one, task) => (one.own.has(task) && one.sum ? one.plan.tasks[task].weight / one.sum : null);
const share = (one, task) => (one.own.has(task) ? one.plan.tasks[task].share : 0);
const tall = (all, least) => Math.max(least, all.tasks.length * LINE + 30);

function drawWeights(all) {
  const most = Math.max(...all.plans.flatMap((one) => all.tasks.map((task) => part(one, task) || 0)), 0.05);
  const top = [0.1, 0.2, 0.4, 0.6, 0.8, 1].find((tick) => tick >= most - 1e-9);
  const f = figure("weights", tall(all, 150), top, all), ends = [];
  axes(f, [0, top / 2, top], (tick) => `${Math.round(tick * 100)} %`);
  for (const task of all.tasks) {
    let path = "", last = null, until = 0;
    for (const one of all.plans) {
      const value = part(one, task);
      if (value === null) { last = null; continue; }
      path += `${last === null || until < one.from ? "M" : "L"}${f.x(one.from)} ${f.y(value)}H${f.x(one.to)}`;
      [last, until] = [value, one.to];
    }
    if (path) f.svg.append(element("path", { "data-task": task, d: path, fill: "none", stroke: color(all, task), "stroke-width": 2 }));
    if (last !== null) ends.push({ name: task, y: f.y(last), color: color(all, task) });
  }
  f.pick = (one, _, value) => {
    const near = (task) => Math.abs((part(one, task) ?? Infinity) - value);
    const [task] = [...one?.own ?? []].sort((a, b) => near(a) - near(b));
    return task ? `${task} ${Math.round(1000 * part(one, task)) / 10} %` : "";
  };
  labels(f, ends);
  finish(f);
}

function drawShares(all) {
  const capacity = (one) => Object.values(one.plan.nodes).reduce((sum, node) => sum + node.capacity, 0);
  const top = Math.max(0.001, ...all.plans.map(capacity)), f = figure("shares", tall(all, 190), top, all), ends = [];
  axes(f, [0, top / 2, top], (tick) => String(Math.round(tick * 1000) / 1000));
  const foot = all.plans.map(() => 0);
  for (const task of all.tasks) {
    let path = "";
    all.plans.forEach((one, i) => {
      const height = share(one, task), low = f.y(foot[i]), high = f.y(foot[i] += height);
      if (height) path += `M${f.x(one.from)} ${low}V${high}H${f.x(one.to)}V${low}Z`;
      if (i + 1 === all.plans.length && one.own.has(task)) ends.push({ name: task, y: (low + high) / 2, color: color(all, task) });
    });
    f.svg.append(element("path", { "data-task": task, d: path, fill: color(all, task) }));
  }
  f.pick = (one, _, value) => {
    let sum = 0;
    const task = one && all.tasks.find((name) => value < (sum += share(one, name)));
    return task ? `${task} ${Math.round(1000 * share(one, task))}m` : "";
  };
  labels(f, ends);
  finish(f);
}

// Which moment the pointer is at, and what is drawn there.
export function valueAt(event) {
  const f = figures[event.id], frame = f.svg.getBoundingClientRect();
  const time = f.time(event.clientX - frame.left), pixel = event.clientY - frame.top;
  const one = f.all.plans.findLast((plan) => plan.from <= time && time <= plan.to);
  return { time, text: f.pick(one, pixel, f.value(pixel)) };
}
