// Task box, selected task, and earlier tasks.
import { $, Problem, ask, coalesced, element, facts, send, words } from "./api.js";
import { exampleOf } from "./suggestions.js";

const MARKS = { done: "✓", failed: "✕", active: "", waiting: "" };
const ENDED = ["succeeded", "failed", "cancelled"];

/** Options of the task box that the user has set. */
function options() {
  const out = {};
  if ($("ask-priority").value !== "0") out.priority = Number($("ask-priority").value);
  if ($("ask-limit").value) out.time_limit_s = 60 * Number($("ask-limit").value);
  if ($("ask-steps").value) out.max_steps = Number($("ask-steps").value);
  return out;
}

export class Tasks {
  /** `onView(task)` is called when another task is selected. */
  constructor(onView) {
    this.tasks = new Map();
    this.heard = new Set(); // ids from events during the request of the list
    this.inView = null;
    this.onView = onView;
    this.vocabulary = null; // names that the detector can look for
    this.hasArm = null; // unknown until the robot's description arrives
    this.suggest = coalesced(() => this.showSuggestions());
    $("ask").addEventListener("submit", (event) => {
      event.preventDefault();
      this.submit();
    });
    $("instruction").addEventListener("keydown", (event) => {
      if (event.key === "Enter" && !event.shiftKey && !event.isComposing) {
        event.preventDefault();
        $("ask").requestSubmit();
      }
    });
    $("cancel").addEventListener("click", () => this.tell("cancel"));
    $("pause").addEventListener("click", () =>
      this.tell(this.tasks.get(this.inView)?.on_hold ? "resume" : "pause"),
    );
  }

  /** Running or paused task, or null. */
  underWay() {
    return [...this.tasks.values()].find((task) => ["running", "paused"].includes(task.state)) ?? null;
  }

  /** Takes the description of the robot. */
  takeRobot(description) {
    const hasArm = description.can_pick && description.can_place;
    if (hasArm === this.hasArm) return;
    this.hasArm = hasArm;
    this.suggest();
  }

  /** Shows the gateway's task suggestions for this robot and home. */
  async showSuggestions() {
    const { tasks: texts, seen } = await ask("/suggestions");
    $("try").hidden = !texts.length;
    $("try").textContent = seen?.length === 0 ? "Nothing has been seen in this home yet. For example:" : "Try";
    if (texts.join() === this.suggested) return; // a redraw would lose the keyboard focus
    this.suggested = texts.join();
    $("suggestions").replaceChildren(...texts.map((text) => element("li", {}, this.chip(text))));
  }

  chip(text) {
    const button = element("button", { type: "button", textContent: text });
    button.addEventListener("click", () => {
      $("instruction").value = text;
      $("instruction").focus();
    });
    return button;
  }

  async load() {
    this.heard.clear();
    const { tasks } = await ask("/tasks");
    const told = new Map(tasks.reverse().map((task) => [task.id, task]));
    for (const id of this.heard) told.set(id, this.tasks.get(id)); // events are newer than the response
    this.tasks = told;
    const all = [...told.values()];
    const running = all.find((task) => task.state === "running");
    this.view((running ?? told.get(this.inView) ?? all.at(-1))?.id ?? null);
  }

  async loadVocabulary() {
    this.vocabulary = await ask("/vocabulary");
    this.suggest();
    const { open, names, detector } = this.vocabulary;
    $("seen-prompt").placeholder = exampleOf(this.vocabulary);
    $("vocabulary-title").textContent = open
      ? `The detector (${detector}) can look for anything.`
      : `Can look for ${names.length} things`;
    $("vocabulary").textContent = open ? "" : `${names.join(", ")}.`;
  }

  take(task) {
    this.heard.add(task.id);
    const isNew = !this.tasks.has(task.id);
    const began = task.state === "running" && this.tasks.get(task.id)?.state !== "running";
    this.tasks.set(task.id, task);
    if (ENDED.includes(task.state)) this.suggest(); // suggestions change: more of the home is known
    const seen = this.tasks.get(this.inView);
    if (began || (isNew && (!seen || ENDED.includes(seen.state)))) this.view(task.id);
    else this.draw();
  }

  view(id) {
    const other = id !== this.inView;
    this.inView = id;
    this.draw();
    if (other) this.onView(this.tasks.get(id) ?? null);
  }

  async submit() {
    const button = $("ask").querySelector("button");
    button.disabled = true;
    $("ask-error").hidden = true;
    try {
      const task = await send("/tasks", { instruction: $("instruction").value, ...options() });
      $("instruction").value = "";
      if (!this.tasks.has(task.id)) this.take(task); // an event may have brought a newer state
      this.view(task.id);
    } catch (error) {
      $("ask-error").textContent =
        error instanceof Problem ? error.message : "The gateway cannot be reached; try again.";
      $("ask-error").hidden = false;
    } finally {
      button.disabled = false;
    }
  }

  /** Sends `what` (cancel, pause or resume) for the selected task. */
  async tell(what) {
    const buttons = [$("cancel"), $("pause")];
    for (const button of buttons) button.disabled = true;
    try {
      await send(`/tasks/${encodeURIComponent(this.inView)}/${what}`); // events report the result
    } catch (error) {
      $("task-message").textContent =
        error instanceof Problem ? error.message : "The gateway cannot be reached; try again.";
    } finally {
      for (const button of buttons) button.disabled = false;
    }
  }

  draw() {
    this.drawHistory();
    const task = this.tasks.get(this.inView);
    $("task").hidden = !task;
    $("task-empty").hidden = Boolean(task);
    $("task-state").hidden = !task;
    $("cancel").hidden = !task || ENDED.includes(task.state);
    $("pause").hidden = !["queued", "running", "paused"].includes(task?.state);
    if (!task) return;
    $("pause").textContent = task.on_hold ? "Resume" : "Pause";
    $("task-state").textContent = task.state;
    $("task-state").dataset.state = task.state;
    $("task-instruction").textContent = task.instruction;
    $("task-message").textContent = task.message || (task.state === "queued" ? "Waits for its turn." : "");
    $("phases").replaceChildren(...task.phases.map(phaseElement));
    const percent = Math.round(100 * (task.state === "succeeded" ? 1 : (task.progress ?? 0)));
    $("progress").setAttribute("aria-valuenow", percent);
    $("progress").firstElementChild.style.width = `${percent}%`;
    this.drawFacts();
  }

  /** Draws the facts; also called every second. */
  drawFacts() {
    const task = this.tasks.get(this.inView);
    if (!task) return;
    const seconds = task.started_s && (task.ended_s ?? Date.now() / 1000) - task.started_s;
    facts($("task-facts"), [
      ["seeks", ENDED.includes(task.state) ? "" : task.seeking],
      ["not used", (task.unused ?? []).map((words) => `“${words}”`).join(", ")],
      ["steps", task.max_steps ? `${task.steps} of ${task.max_steps}` : task.steps],
      ["picks", task.picks || ""],
      ["priority", task.priority || ""],
      ["time", seconds > 0 && seconds < 86400 ? `${Math.round(seconds)} s` : ""],
      ["left", ENDED.includes(task.state) ? "" : spanOf(task.eta_s)],
      ["cause", task.cause],
    ]);
  }

  drawHistory() {
    $("history-empty").hidden = this.tasks.size > 0;
    const newest = [...this.tasks.values()].reverse().slice(0, 20);
    const drawn = newest.map((task) => `${task.id} ${task.state}`).join() + this.inView;
    if (drawn === this.drawn) return; // a redraw would lose the keyboard focus
    this.drawn = drawn;
    const focused = document.activeElement?.closest("#history button")?.dataset.id;
    $("history").replaceChildren(
      ...newest.map((task) => {
        const badge = element("span", { className: "badge", textContent: task.state });
        badge.dataset.state = task.state;
        const text = element("span", { className: "text", textContent: task.instruction });
        const button = element("button", { type: "button", title: task.instruction }, text, badge);
        button.dataset.id = task.id;
        button.setAttribute("aria-current", task.id === this.inView);
        button.addEventListener("click", () => this.view(task.id));
        return element("li", {}, button);
      }),
    );
    if (focused) $("history").querySelector(`[data-id="${CSS.escape(focused)}"]`)?.focus();
  }
}

/** Remaining time as text, from [low, high] seconds; empty if unknown. */
function spanOf(seconds) {
  if (!seconds) return "";
  const [low, high] = seconds.map(Math.round);
  return high < 120 ? `about ${low} to ${high} s` : `about ${Math.round(low / 60)} to ${Math.round(high / 60)} min`;
}

function phaseElement(phase) {
  const dot = element("span", { className: "dot", textContent: MARKS[phase.state] });
  dot.ariaHidden = "true";
  const said = element("span", { className: "hidden", textContent: `: ${phase.state}` });
  const out = element("li", {}, dot, element("span", { textContent: words(phase.name) }, said));
  out.dataset.state = phase.state;
  if (phase.state !== "waiting") out.dataset.done = "";
  return out;
}
