// Page of all robots: their state, task and picture, and the tasks that wait for a robot.
import "./access.js";
import { $, Problem, ask, coalesced, element, facts, number, send } from "./api.js";
import { COMMANDS, whyNot } from "./commands.js";

const PERIOD_MS = 1000;
const PICTURE_MS = 2000;
const COLORS = { "idle": "ready", "busy": "running", "not ready": "waiting", "stopped": "failed", "away": "lost" };
const cards = new Map();

const UNREACHABLE = "The gateway cannot be reached; try again.";
const said = (error) => (error instanceof Problem ? error.message : UNREACHABLE);
const rootOf = (name) => `/robots/${encodeURIComponent(name)}`;

/** Card of one robot; `show` draws its newest state. */
class RobotCard {
  constructor(name) {
    this.name = name;
    this.picture = null;
    this.pill = element("span", { className: "pill" });
    this.image = element("img", { alt: `newest picture of ${name}`, hidden: true });
    this.blank = element("p", { className: "empty", textContent: "No picture yet." });
    this.instruction = element("p", { className: "instruction" });
    this.bar = element("span");
    this.progress = element("div", { className: "bar", role: "progressbar", ariaLabel: `progress of ${name}` }, this.bar);
    this.progress.setAttribute("aria-valuemin", 0);
    this.progress.setAttribute("aria-valuemax", 100);
    this.message = element("p", { className: "message" });
    this.facts = element("dl", { className: "facts" });
    this.clear = this.button("Clear stop", "clear-stop");
    this.clear.hidden = true;
    const link = element("a", { href: `/?robot=${encodeURIComponent(name)}`, textContent: name });
    const head = element("div", { className: "head" }, element("h3", {}, link), this.pill,
      element("span", { className: "spring" }), this.button("Stop", "stop"));
    this.root = element("li", { className: "card" }, head,
      element("div", { className: "camera" }, this.image, this.blank),
      this.instruction, this.progress, element("div", { className: "row" }, this.message, this.clear), this.facts);
  }

  button(label, what) {
    const button = element("button", { type: "button", textContent: label, ariaLabel: `${label}: ${this.name}` });
    button.addEventListener("click", () => this.press(what));
    return button;
  }

  show({ state, reasons, task, pose, battery, held, picture }) {
    this.picture = state === "away" ? null : picture;
    this.root.classList.toggle("away", state === "away");
    this.pill.textContent = state;
    this.pill.dataset.state = COLORS[state] ?? "waiting";
    this.clear.hidden = state !== "stopped";
    this.instruction.textContent = task ? task.instruction : state === "idle" ? "No task" : "";
    const percent = Math.round(100 * (task?.progress ?? 0));
    this.progress.hidden = !task;
    this.progress.setAttribute("aria-valuenow", percent);
    this.bar.style.width = `${percent}%`;
    const why = reasons.join(" · ").replace("/v1/robot/clear-stop", "you clear the stop");
    this.message.textContent = task ? task.message : why;
    facts(this.facts, [
      ["battery", battery == null ? "" : `${Math.round(100 * battery)} %`],
      ["holds", held],
      ["at", pose && `${number(pose.x_m, 1)}, ${number(pose.y_m, 1)} m`],
      ["steps", task ? task.steps : ""],
    ]);
  }

  showPicture() {
    if (!this.picture) return;
    const next = new Image();
    next.onload = () => {
      this.image.src = next.src;
      this.image.hidden = false;
      this.blank.hidden = true;
    };
    next.src = `${this.picture}?at=${Date.now()}`;
  }

  async press(what) {
    $("failed").hidden = true;
    showFailures([await command(this.name, what)]);
    load();
  }
}

/** Sends stop or clear-stop to a robot. Returns why it failed, "" if it did not. */
async function command(name, what) {
  const signal = AbortSignal.timeout(COMMANDS[what].within_ms);
  try {
    await send(`${rootOf(name)}/robot/${what}`, undefined, { signal });
    return "";
  } catch (error) {
    return `${name}: ${whyNot(what, error)}`;
  }
}

function showFailures(failures) {
  const said = failures.filter(Boolean);
  $("failed").textContent = said.join(" ");
  $("failed").hidden = !said.length;
}

function showRobots(robots) {
  for (const robot of robots) {
    if (!cards.has(robot.name)) {
      cards.set(robot.name, new RobotCard(robot.name));
      $("robots").append(cards.get(robot.name).root);
      $("ask-robot").append(element("option", { value: robot.name, textContent: robot.name }));
    }
    const card = cards.get(robot.name);
    const isFirst = card.picture === null && robot.picture;
    card.show(robot);
    if (isFirst) card.showPicture();
  }
  const counts = Object.keys(COLORS).map((state) => [robots.filter((r) => r.state === state).length, state]);
  $("count").textContent = counts.filter(([count]) => count).map(([count, state]) => `${count} ${state}`).join(" · ");
}

function showQueue(tasks) {
  $("queue-empty").hidden = tasks.length > 0;
  const drawn = JSON.stringify(tasks.map((t) => [t.id, t.state, t.robot, t.message]));
  if (drawn === showQueue.drawn) return; // a redraw would lose the keyboard focus
  showQueue.drawn = drawn;
  const focused = document.activeElement?.closest("#queue button")?.dataset.id;
  $("queue").replaceChildren(...tasks.map(row));
  if (focused) $("queue").querySelector(`[data-id="${CSS.escape(focused)}"]`)?.focus();
}

function row(task) {
  const badge = element("span", { className: "badge", textContent: task.state });
  badge.dataset.state = task.state;
  const cancel = element("button", { type: "button", textContent: "Cancel", ariaLabel: `Cancel: ${task.instruction}` });
  cancel.dataset.id = task.id;
  cancel.addEventListener("click", async () => {
    cancel.disabled = true;
    await send(`/fleet/tasks/${encodeURIComponent(task.id)}/cancel`).catch((error) => {
      $("failed").textContent = `The task is not cancelled: ${said(error)}`;
      $("failed").hidden = false;
    });
    load();
  });
  const place = element("span", { className: "hint", textContent: task.robot ?? "no robot yet" });
  return element("li", {}, element("p", { className: "instruction", textContent: task.instruction }), cancel,
    element("div", { className: "place" }, badge, place),
    ...(task.state === "queued" || task.robot === null ? [element("p", { className: "message", textContent: task.message })] : []),
    ...(task.why ? [element("p", { className: "why", textContent: task.why })] : []));
}

const load = coalesced(async () => {
  try {
    const { robots, tasks } = await ask("/fleet");
    $("lost").hidden = true;
    showRobots(robots);
    showQueue(tasks);
  } catch (error) {
    $("lost").hidden = error instanceof Problem;
    $("count").textContent = error instanceof Problem ? error.message : "connection lost";
    throw error;
  }
});

$("ask").addEventListener("submit", async (event) => {
  event.preventDefault();
  const button = $("ask").querySelector("button");
  button.disabled = true;
  $("ask-error").hidden = true;
  try {
    await send("/fleet/tasks", {
      instruction: $("instruction").value,
      robot: $("ask-robot").value,
      priority: Number($("ask-priority").value),
    });
    $("instruction").value = "";
    load();
  } catch (error) {
    $("ask-error").textContent = said(error);
    $("ask-error").hidden = false;
  } finally {
    button.disabled = false;
  }
});
$("instruction").addEventListener("keydown", (event) => {
  if (event.key === "Enter" && !event.shiftKey && !event.isComposing) {
    event.preventDefault();
    $("ask").requestSubmit();
  }
});
$("stop-all").addEventListener("click", async () => {
  $("failed").hidden = true;
  $("stop-all").textContent = "Stopping…";
  const stops = [...cards.keys()].map((name) => command(name, "stop"));
  try { // robots that the page does not show yet
    const { robots } = await ask("/robots", { signal: AbortSignal.timeout(COMMANDS.stop.within_ms) });
    stops.push(...robots.filter(({ name }) => !cards.has(name)).map(({ name }) => command(name, "stop")));
  } catch (error) {
    if (!stops.length) stops.push(`Nothing was stopped, as no robot is known: ${said(error)}`);
  }
  showFailures(await Promise.all(stops));
  $("stop-all").textContent = "Stop all";
  load();
});

setInterval(() => document.hidden || load(), PERIOD_MS);
setInterval(() => document.hidden || cards.forEach((card) => card.showPicture()), PICTURE_MS);
load();
