// The Gaussians in 3D: viser's page in a frame, playing a scene that the gateway made.
import { $, address, element, get } from "./api.js";

const COLORS = { color: "As seen", class: "Class", probability: "Probability", uncertainty: "Uncertainty" };

export class View3d {
  /** `bounds()` gives [left, bottom, right, top] of the map in metres, or null. */
  constructor(bounds) {
    this.bounds = bounds;
    this.color = "class";
    this.shown = false;
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
    $("refresh-3d").addEventListener("click", () => this.load());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.load());
  }

  show(shown) {
    this.shown = shown;
    $("show-2d").setAttribute("aria-pressed", !shown);
    $("show-3d").setAttribute("aria-pressed", shown);
    for (const id of ["frame-2d", "layers", "map-tools", "legend-2d"]) $(id).hidden = shown;
    for (const id of ["frame-3d", "colors"]) $(id).hidden = !shown;
    $("refresh-3d").hidden = true;
    if (shown) this.load();
    else $("view-3d").removeAttribute("src"); // what nobody sees costs nothing
  }

  /** There is something newer than what is on show; the view is kept until a person asks. */
  changed() {
    if (this.shown) $("refresh-3d").hidden = false;
  }

  async load() {
    if (!this.shown) return;
    $("refresh-3d").hidden = true;
    const scene = `/objects.viser?color=${this.color}`;
    try {
      const response = await get(scene); // the frame has it from the browser's store, by its tag
      if (!response.ok) {
        this.say((await response.json().catch(() => ({}))).detail ?? "There is no scene.");
        return;
      }
    } catch {
      this.say("The gateway cannot be reached.");
      return;
    }
    const query = new URLSearchParams({ playbackPath: address(scene), ...this.camera() });
    if (matchMedia("(prefers-color-scheme: dark)").matches) query.set("darkMode", "");
    $("view-3d").src = `${address("/view3d")}?${query}`;
    this.say("");
  }

  /** Above one side of the map, looking at its middle. */
  camera() {
    const bounds = this.bounds();
    if (!bounds) return {};
    const [left, bottom, right, top] = bounds;
    const [x, y] = [(left + right) / 2, (bottom + top) / 2];
    const size = Math.max(right - left, top - bottom, 2);
    return {
      initialCameraPosition: [x, y - 0.6 * size, 0.7 * size].map((v) => v.toFixed(2)).join(),
      initialCameraLookAt: [x, y, 0].map((v) => v.toFixed(2)).join(),
      initialCameraUp: "0,0,1",
    };
  }

  say(text) {
    $("empty-3d").textContent = text;
    $("empty-3d").hidden = !text;
    $("view-3d").hidden = Boolean(text);
  }
}
