// The lists and tables: rows stay where they are while their values change, so that a pointer or a focus keeps its row.
const cores = (value) => (value === null || value === undefined ? "-" : `${Math.round(value * 1000)}m`);
const seconds = (value) => (value < 1 ? `${Math.round(value * 1000)} ms` : `${value.toFixed(1)} s`);
const percent = (part) => `${Math.round(part * 100)} %`;
const sum = (values) => (values.every((value) => value === null) ? null : values.reduce((a, b) => a + (b || 0), 0));

export function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function made(name, role, text = "") {
  const node = document.createElement(name);
  if (role) node.setAttribute("role", role);
  node.textContent = text;
  return node;
}

// One child per name, made once.
function children(parent, names, make, fill) {
  const have = new Map([...parent.children].map((child) => [child.dataset.name, child]));
  for (const [name, child] of have) if (!names.includes(name)) child.remove();
  names.forEach((name, i) => {
    const child = have.get(name) || make(name);
    child.dataset.name = name;
    if (parent.children[i] !== child) parent.insertBefore(child, parent.children[i] || null);
    fill(child, name);
  });
}

// `cells` are the texts of a row's columns; the first is its name.
function table(id, columns, names, cells, pick) {
  const [head] = document.getElementById(id).tHead.rows, [body] = document.getElementById(id).tBodies;
  if (!head.cells.length) head.append(...columns.map((column) => made("th", "columnheader", column)));
  children(body, names, (name) => row(columns, name, pick), (line, name) => {
    cells(name).forEach((text, i) => {
      write(line.cells[i + 1].lastChild, text);
      line.cells[i + 1].classList.toggle("none", text === "-");
    });
  });
  return body;
}

// A column in which nothing is known leaves its room to the others.
function hideEmpty(id) {
  const own = document.getElementById(id), rows = [...own.tBodies[0].rows];
  [...own.tHead.rows[0].cells].forEach((head, i) => {
    head.hidden = i > 0 && rows.every((line) => line.cells[i].classList.contains("none"));
    for (const line of rows) line.cells[i].hidden = head.hidden;
  });
}

function row(columns, name, pick) {
  const line = made("tr", "row"), first = made("th", "rowheader", pick ? "" : name);
  if (pick) {
    first.append(made("button", "", name));
    line.addEventListener("click", () => pick(name));
  }
  line.append(first, ...columns.slice(1).map((column) => {
    const cell = made("td", "cell");
    cell.append(Object.assign(made("i", "", column), { ariaHidden: "true" }), made("span"));
    return cell;
  }));
  return line;
}

export function drawTasks(plan, board, chosen, pick) {
  const tasks = plan ? plan.tasks : {}, columns = ["task", "weight", "share", "limit", "use", "throttled", "health", "because"];
  const body = table("tasks", columns, Object.keys(tasks), (name) => {
    const task = tasks[name], own = board ? board.containers.filter((one) => one.task === name) : [];
    const limit = own.length ? sum(own.map((one) => one.limit)) : null, use = own.length ? sum(own.map((one) => one.use)) : null;
    const throttled = own.some((one) => one.throttled !== null) ? Math.max(...own.map((one) => one.throttled || 0)) : null;
    const parts = use === null ? "" : [[limit, "limit"], [task.share, "share"]].filter(([of]) => of)
      .map(([of, what]) => `${percent(use / of)} of ${what}`).join(", ");
    return [String(Math.round(task.weight * 100) / 100), cores(task.share) + (task.suspended ? " (suspended)" : ""), cores(limit),
      cores(use) + (parts && ` (${parts})`), throttled === null ? "-" : percent(throttled), health(board?.health[name]), task.because];
  }, pick);
  hideEmpty("tasks");
  for (const line of body.rows) {
    line.className = line.dataset.name === chosen ? "chosen" : "";
    line.querySelector("button").setAttribute("aria-pressed", line.dataset.name === chosen);
  }
}

function health(said) {
  const parts = !said ? [] : [said.misses !== null && `misses ${percent(said.misses)}`, said.queue !== null && `queue ${said.queue}`,
    said.latency !== null && `takes ${seconds(said.latency)}`];
  return parts.filter(Boolean).join(", ") || "-";
}

export function drawStreams(streams) {
  const body = table("streams", ["stream", "age", "samples", "state", "key"], Object.keys(streams), (name) => {
    const stream = streams[name];
    return [stream.age === null ? "-" : seconds(stream.age), String(stream.samples),
      stream.silent ? "silent" : stream.age === null ? "not heard yet" : "heard", stream.key];
  });
  for (const line of body.rows) line.className = streams[line.dataset.name].silent ? "bad" : "";
}

const MARKS = { True: "✓", False: "✗" };

export function drawConditions(conditions) {
  const by = Object.fromEntries(conditions.map((one) => [one.type, one]));
  const make = () => {
    const item = made("li"), fold = made("details");
    fold.append(made("summary"), made("p"));
    item.append(fold);
    return item;
  };
  children(document.getElementById("conditions"), Object.keys(by), make, (item, name) => {
    const one = by[name], [fold] = item.children, changed = item.dataset.status !== one.status;
    write(fold.firstChild, `${MARKS[one.status] || "?"} ${name}`);
    write(fold.lastChild, one.message || one.reason);
    if (changed) fold.open = one.status !== "True";
    item.dataset.status = one.status;
    item.className = one.status === "True" ? "" : "bad";
  });
}

export function reactions(r) {
  return r ? `median ${seconds(r.median)}, worst ${seconds(r.worst)}, last ${seconds(r.last)} of the latest ${r.count}` : "none yet";
}
