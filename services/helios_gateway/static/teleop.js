// Teleoperation: sends the held command ten times a second; the robot stops when none is held.
import { $, address } from "./api.js";

const REPEAT_MS = 100; // at the gateway a command expires after 300 ms
const KEYS = {
  w: [1, 0], arrowup: [1, 0], s: [-1, 0], arrowdown: [-1, 0],
  a: [0, 1], arrowleft: [0, 1], d: [0, -1], arrowright: [0, -1],
};
const PRESSES = [" ", "enter"]; // keys that press the focused button

const directionOf = ({ dataset }) => [Number(dataset.forward ?? 0), Number(dataset.turn ?? 0)];

export class Teleop {
  constructor() {
    this.held = new Map(); // pointer or key -> [forward, turn]
    this.socket = null;
    this.timer = null;
    this.task = null; // running or paused task
    this.description = null;
    this.said = ""; // message, such as the reason of a refusal
    this.state = "standing";
    const pad = $("pad");
    for (const button of pad.querySelectorAll("button")) this.listenTo(button);
    pad.addEventListener("keydown", (event) => this.keyDown(event));
    pad.addEventListener("keyup", (event) => this.release(`key ${event.key.toLowerCase()}`));
    pad.addEventListener("focusout", (event) => {
      if (!pad.contains(event.relatedTarget)) this.releaseAll();
    });
    pad.addEventListener("contextmenu", (event) => event.preventDefault()); // opened by a long touch
    for (const gone of ["blur", "pagehide"]) window.addEventListener(gone, () => this.releaseAll());
    document.addEventListener("visibilitychange", () => {
      if (document.hidden) this.releaseAll();
    });
  }

  listenTo(button) {
    const what = directionOf(button);
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || button.disabled) return;
      button.setPointerCapture(event.pointerId);
      this.hold(`pointer ${event.pointerId}`, what);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      button.addEventListener(end, (event) => this.release(`pointer ${event.pointerId}`));
    }
  }

  keyDown(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) {
      this.releaseAll(); // macOS sends no keyup of a letter that is released while Cmd is down
      return;
    }
    const key = event.key.toLowerCase();
    const button = event.target.closest("button");
    const what = KEYS[key] ?? (PRESSES.includes(key) && button && directionOf(button));
    if (!what) return;
    event.preventDefault(); // prevents scrolling
    if (!event.repeat && this.mayHold(what)) this.hold(`key ${key}`, what);
  }

  /** Takes the description of the robot. */
  takeRobot(description) {
    this.description = description;
    this.draw();
  }

  /** Takes the running or paused task, or null. */
  takeTask(task) {
    this.task = task;
    this.draw();
  }

  mayHold([forward]) {
    if (!this.description?.can_move || (this.task && !this.held.size)) return false;
    return forward >= 0 || this.description.max_back_m > 0;
  }

  hold(source, what) {
    this.held.set(source, what);
    if (!this.timer) {
      this.said = "";
      this.connect();
      this.timer = setInterval(() => this.send(), REPEAT_MS);
    }
    this.send();
    this.draw();
  }

  release(source) {
    if (this.held.delete(source)) this.afterRelease();
  }

  releaseAll() {
    if (!this.held.size) return;
    this.held.clear();
    this.afterRelease();
  }

  afterRelease() {
    if (!this.held.size) {
      clearInterval(this.timer);
      this.timer = null;
    }
    this.send();
    this.draw();
  }

  connect() {
    if (this.socket && this.socket.readyState <= WebSocket.OPEN) return;
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}${address("/robot/teleop")}`);
    let opened = false;
    socket.onopen = () => {
      opened = true;
      this.send();
    };
    socket.onmessage = ({ data }) => this.take(JSON.parse(data));
    socket.onclose = ({ reason }) => {
      if (this.socket !== socket) return;
      this.socket = null;
      const driving = this.held.size > 0;
      this.releaseAll();
      if (!opened) this.sayWhyNot();
      else if (driving) this.say(`The connection ended, and the robot stands: ${reason || "it broke off"}.`);
    };
    this.socket = socket;
  }

  /** Shows why no socket opened, which the browser does not report. */
  async sayWhyNot() {
    const session = await fetch("/v1/session").then((response) => response.json()).catch(() => null);
    this.say(
      ["read", "task"].includes(session?.scope) ? `The key “${session.name}” may ${session.scope === "read" ? "look" : "give tasks"}; driving needs one of scope robot.`
        : session ? "No connection to drive by was opened; try again."
        : "The gateway cannot be reached; the robot is not driven.",
    );
  }

  send() {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    const share = Number($("drive-speed").value);
    const sum = (axis) => {
      const total = [...this.held.values()].reduce((all, what) => all + what[axis], 0);
      return share * Math.max(-1, Math.min(1, total));
    };
    this.socket.send(JSON.stringify({ forward: sum(0), turn: sum(1) }));
  }

  take({ state, reason }) {
    this.state = state;
    if (state === "refused" || reason) this.said = reason;
    else if (state === "driving") this.said = "";
    this.draw();
  }

  say(text) {
    this.said = text;
    this.draw();
  }

  draw() {
    const { can_move, max_back_m } = this.description ?? {};
    const still = this.description && !can_move;
    const busy = this.task && !this.held.size;
    for (const button of $("pad").querySelectorAll("button")) {
      const what = directionOf(button);
      button.disabled = still || busy || !this.description || (what[0] < 0 && !(max_back_m > 0));
      button.classList.toggle("held", [...this.held.values()].some((held) => held.join() === what.join()));
    }
    $("drive-back-hint").hidden = !can_move || max_back_m > 0;
    $("drive-said").textContent = still ? "This robot offers no motion: it cannot be driven."
      : busy ? `A task has the robot (it is ${this.task.state}). Cancel it to drive by hand.`
      : this.task ? "A task waits for the robot: let go, and it begins."
      : this.said || (this.held.size && this.state === "driving" ? "Drives." : "");
  }
}
