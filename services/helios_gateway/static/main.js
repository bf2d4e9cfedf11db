// Joins the parts of the page to the events.
import { $, Problem, ask, coalesced, element, facts, listen, number, send } from "./api.js";
import { MapView } from "./map.js";
import { Tasks } from "./tasks.js";
import { Why } from "./why.js";

const CAMERA_PERIOD_MS = 500;
const ORDER = ["router", "world", "bridge", "detector", "objectmap", "map2d", "planner", "gateway"];

const map = new MapView();
const why = new Why((decision) => {
  map.decision = decision;
  map.redraw();
});
const tasks = new Tasks((task) => why.view(task));
const services = new Map();
const versions = { map2d: -1, objects: -1 };

const loadObjects = coalesced(async () => {
  const { objects } = await ask("/v1/objects");
  map.objects = objects;
  map.redraw();
  const cells = (texts) => texts.map((textContent) => element("td", { textContent }));
  const rows = objects
    .sort((a, b) => (b.score ?? 0) - (a.score ?? 0))
    .map((o) => element("tr", {}, ...cells([o.class, number(o.score), o.views, o.center_m.map((v) => number(v)).join(" ")])));
  const head = ["class", "Ψ", "views", "centre (m)"].map((textContent) => element("th", { textContent, scope: "col" }));
  $("objects").replaceChildren(element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...rows));
  $("objects").hidden = !objects.length;
  $("objects-empty").hidden = objects.length > 0;
});
const loadTasks = coalesced(() => tasks.load());
const loadVocabulary = coalesced(() => tasks.loadVocabulary());

listen(
  {
    task: (task) => tasks.take(task),
    decision: (decision) => why.take(decision),
    plan: (plan) => {
      map.plan = plan;
      map.redraw();
    },
    robot: showRobot,
    service: showService,
    ready: showReady,
    map: (change) => {
      if (change.map2d !== versions.map2d) map.load();
      if (change.objects !== versions.objects) loadObjects();
      Object.assign(versions, change);
    },
  },
  () => {
    $("lost").hidden = true;
    versions.map2d = versions.objects = -1;
    for (const load of [loadTasks, loadVocabulary, loadObjects, map.load, why.load]) load();
  },
  () => {
    $("lost").hidden = false;
    $("ready").textContent = "connection lost";
    $("ready").dataset.state = "lost";
  },
);

function showReady({ ready, reasons }) {
  $("ready").textContent = ready ? "ready" : "not ready";
  $("ready").dataset.state = ready ? "ready" : "waiting";
  $("ready").title = reasons.join("\n");
}

function showRobot({ connected, state, description }) {
  if (description) {
    const isSaid = !description.simulated || description.name.includes("simulated");
    $("robot-name").textContent = description.name + (isSaid ? "" : " · simulated");
    document.title = `HELIOS · ${description.name}`;
  }
  map.description = description;
  map.robot = state;
  map.redraw();
  $("stopped").hidden = !state?.stopped;
  $("clear-stop").hidden = !state?.stopped;
  if (!state) return;
  const { pose } = state;
  const degrees = pose && ((pose.yaw_rad * 180) / Math.PI).toFixed(0);
  const doing = !connected ? "bridge away" : state.stopped ? "stopped" : state.moving ? "moving" : "at rest";
  facts($("robot-facts"), [
    ["robot", doing],
    ["x", pose && `${number(pose.x_m)} m`],
    ["y", pose && `${number(pose.y_m)} m`],
    ["heading", pose && `${degrees}°`],
    ["holds", state.held],
    ["", state.message],
  ]);
}

function showService(service) {
  services.set(service.name, service);
  const place = ({ name }) => (ORDER.indexOf(name) + ORDER.length + 1) % (ORDER.length + 1);
  const inOrder = [...services.values()].sort((a, b) => place(a) - place(b));
  $("services").replaceChildren(
    ...inOrder.map(({ name, state, reason, restarts, pid }) => {
      const dot = element("span", { className: "dot" });
      dot.ariaHidden = "true";
      const link = reason.startsWith("http") ? "" : reason;
      const out = element(
        "li",
        { title: pid ? `process ${pid}` : "" },
        dot,
        element("span", { textContent: name }),
        element("span", { className: "state", textContent: state }),
        element("span", {
          className: restarts ? "restarts some" : "restarts",
          textContent: `${restarts} restart${restarts === 1 ? "" : "s"}`,
        }),
        element("span", { className: "reason", textContent: link }),
      );
      out.dataset.state = state;
      return out;
    }),
  );
}

async function command(path) {
  $("failed").hidden = true;
  try {
    showRobot(await send(path));
  } catch (error) {
    const said = error instanceof Problem ? error.message : "the gateway cannot be reached";
    $("failed").textContent = `${path.endsWith("/stop") ? "The stop did not get through" : "Not cleared"}: ${said}.`;
    $("failed").hidden = false;
  }
}
$("stop").addEventListener("click", () => command("/v1/robot/stop"));
$("clear-stop").addEventListener("click", () => command("/v1/robot/clear-stop"));

async function showCamera() {
  if (document.hidden) return;
  const response = await fetch(`/v1/camera.jpg?raw=${$("boxes").checked ? 0 : 1}`);
  if (!response.ok) return;
  const old = $("camera").src;
  $("camera").src = URL.createObjectURL(await response.blob());
  $("camera").hidden = false;
  $("camera-empty").hidden = true;
  if (old) URL.revokeObjectURL(old);
}
const nextPicture = coalesced(showCamera);
$("boxes").addEventListener("change", nextPicture);
setInterval(nextPicture, CAMERA_PERIOD_MS);
nextPicture();
setInterval(() => tasks.drawFacts(), 1000);
