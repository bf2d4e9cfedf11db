// 3D view of the Gaussians: viser's page in a frame plays a scene of the gateway. When the map
// changes, the next scene loads behind the current one and replaces it with the same camera.
import { $, address, element, get } from "./api.js";

const COLORS = { color: "As seen", class: "Class", probability: "Probability", uncertainty: "Uncertainty" };
const TITLE = "Gaussians of the object map in 3D: drag to turn, scroll to zoom";
const RENEW_MS = 4000; // from a map change to the next scene
const DRAWN_MS = 600; // from a loaded scene to a drawn one
const STILL_MS = 800; // a camera at rest for this time is not being dragged

export class View3d {
  /** `bounds()` returns [left, bottom, right, top] of the map in metres, or null. */
  constructor(bounds) {
    this.bounds = bounds;
    this.color = "class";
    this.shown = false;
    this.frame = null; // visible frame
    this.coming = null; // next frame, behind the visible one
    this.camera = ""; // viser's camera parameters; empty until the user moves it
    this.movedMs = -Infinity;
    this.timer = null;
    const buttons = Object.entries(COLORS).map(([name, textContent]) => {
      const button = element("button", { type: "button", textContent });
      button.setAttribute("aria-pressed", name === this.color);
      button.addEventListener("click", () => {
        this.color = name;
        for (const other of buttons) other.setAttribute("aria-pressed", other === button);
        this.load();
      });
      return button;
    });
    $("colors").replaceChildren(...buttons);
    $("show-2d").addEventListener("click", () => this.show(false));
    $("show-3d").addEventListener("click", () => this.show(true));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.load());
    document.addEventListener("visibilitychange", () => document.hidden || this.load());
    addEventListener("message", (event) => {
      if (event.origin === location.origin && typeof event.data?.viser === "string") {
        this.hear(event.source, event.data.viser);
      }
    });
  }

  show(shown) {
    if (shown === this.shown) return;
    this.shown = shown;
    $("show-2d").setAttribute("aria-pressed", !shown);
    $("show-3d").setAttribute("aria-pressed", shown);
    for (const id of ["frame-2d", "layers", "map-tools", "legend-2d"]) $(id).hidden = shown;
    for (const id of ["frame-3d", "colors", "legend-3d"]) $(id).hidden = !shown;
    if (shown) this.load();
    else this.close(); // a hidden view uses no resources
  }

  close() {
    clearTimeout(this.timer);
    this.timer = null;
    for (const frame of [this.frame, this.coming]) frame?.remove();
    this.frame = this.coming = null;
  }

  /** Schedules a reload after a map change. */
  changed() {
    if (this.shown) this.later(RENEW_MS);
  }

  later(ms) {
    this.timer ??= setTimeout(() => {
      this.timer = null;
      this.load();
    }, ms);
  }

  async load() {
    if (!this.shown || document.hidden) return;
    const { color } = this;
    const scene = `/objects.viser?color=${color}`;
    try {
      const response = await get(scene); // fills the browser cache, which the frame uses
      if (color !== this.color) return;
      if (!response.ok) {
        this.say((await response.json().catch(() => ({}))).detail ?? "There is no scene.");
        return;
      }
      await response.arrayBuffer();
    } catch {
      this.say("The gateway cannot be reached.");
      return;
    }
    if (!this.shown || color !== this.color) return; // hidden, or a newer request is under way
    const query = new URLSearchParams({ playbackPath: address(scene), logCamera: "" });
    if (matchMedia("(prefers-color-scheme: dark)").matches) query.set("darkMode", "");
    const src = `${address("/view3d")}#${query}&${this.camera || this.above()}`;
    const frame = element("iframe", { title: TITLE, src });
    frame.camera = this.camera;
    this.say("");
    this.coming?.remove();
    this.coming = frame;
    if (this.frame === null) this.swap();
    else frame.className = "coming";
    $("frame-3d").append(frame);
  }

  /** Camera parameters above one side of the map, facing its middle. */
  above() {
    const bounds = this.bounds();
    if (!bounds) return "";
    const [left, bottom, right, top] = bounds;
    const [x, y] = [(left + right) / 2, (bottom + top) / 2];
    const size = Math.max(right - left, top - bottom, 2);
    const point = (...values) => values.map((v) => v.toFixed(2)).join();
    return new URLSearchParams({
      initialCameraPosition: point(x, y - 0.45 * size, 0.6 * size),
      initialCameraLookAt: point(x, y, 0),
      initialCameraUp: "0,0,1",
    }).toString();
  }

  /** Handles a log line of viser's page: a camera move, or a loaded scene. */
  hear(source, said) {
    if (said.startsWith("&initialCamera") && source === this.frame?.contentWindow) {
      this.camera = said.slice(1);
      this.movedMs = performance.now();
    } else if (said.startsWith("File loaded") && source === this.coming?.contentWindow) {
      const frame = this.coming;
      setTimeout(() => frame === this.coming && this.swap(), DRAWN_MS);
    }
  }

  /** Replaces the visible frame by the next one, unless the user moved the camera meanwhile. */
  swap() {
    const held = performance.now() - this.movedMs < STILL_MS || this.coming.camera !== this.camera;
    if (this.frame !== null && held) {
      this.coming.remove();
      this.coming = null;
      this.later(STILL_MS);
      return;
    }
    this.frame?.remove();
    this.frame = this.coming;
    this.coming = null;
    this.frame.id = "view-3d";
    this.frame.className = "";
  }

  /** Shows a text in place of the scene; "" shows the scene. */
  say(text) {
    $("empty-3d").textContent = text;
    $("empty-3d").hidden = !text;
    if (this.frame) this.frame.hidden = Boolean(text);
  }
}
