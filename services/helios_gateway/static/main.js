// Connects the parts of the page to the event stream.
import { showRobots } from "./access.js";
import { $, coalesced, facts, get, listen, number } from "./api.js";
import { MapView } from "./map.js";
import { Objects } from "./objects.js";
import { Seen } from "./seen.js";
import { showReady, showService } from "./services.js";
import { showStopped } from "./stop.js";
import { Tasks } from "./tasks.js";
import { Teleop } from "./teleop.js";
import { View3d } from "./view3d.js";
import { Why } from "./why.js";

const CAMERA_PERIOD_MS = 500;

const map = new MapView();
const why = new Why((decision) => {
  map.decision = decision;
  map.redraw();
});
const objects = new Objects(
  (list) => {
    map.objects = list;
    map.redraw();
  },
  (object) => map.point(object?.center_m.slice(0, 2) ?? null),
);
const view3d = new View3d(() => (map.info ? map.bounds : null));
new Seen((place) => {
  view3d.show(false);
  map.point(place);
});
const tasks = new Tasks((task) => why.view(task));
const teleop = new Teleop();
const versions = { map2d: -1, objects: -1 };
let lastReady = null;

const loadTasks = coalesced(async () => {
  await tasks.load();
  const task = tasks.underWay();
  teleop.takeTask(task);
  if (map.plan && map.plan.task_id !== task?.id) { // it ended while the connection was lost
    map.plan = null;
    map.redraw();
  }
});
const loadVocabulary = coalesced(() => tasks.loadVocabulary());

listen(
  {
    task: (task) => {
      tasks.take(task);
      teleop.takeTask(tasks.underWay());
    },
    decision: (decision) => why.take(decision),
    plan: (plan) => {
      map.plan = plan;
      map.redraw();
    },
    robot: showRobot,
    service: showService,
    ready: (ready) => showReady((lastReady = ready)),
    map: (change) => {
      if (change.map2d !== versions.map2d) map.load();
      if (change.objects !== versions.objects) {
        objects.load();
        view3d.changed();
      }
      Object.assign(versions, change);
    },
  },
  () => {
    $("lost").hidden = true;
    if (lastReady) showReady(lastReady); // it is sent again only when it changes
    versions.map2d = versions.objects = -1;
    showRobots().catch(() => {});
    for (const load of [loadTasks, loadVocabulary, objects.load, map.load, why.load]) load();
  },
  () => {
    $("lost").hidden = false;
    $("ready").textContent = "connection lost";
    $("ready").dataset.state = "lost";
  },
);

function showRobot({ connected, state, description }) {
  if (description) {
    const isSaid = !description.simulated || description.name.includes("simulated");
    $("robot-name").textContent = description.name + (isSaid ? "" : " · simulated");
    document.title = `HELIOS · ${description.name}`;
    tasks.takeRobot(description);
    teleop.takeRobot(description);
  }
  map.description = description;
  map.robot = state;
  map.redraw();
  showStopped(state?.stopped, state?.message);
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

async function showCamera() {
  if (document.hidden) return;
  const response = await get(`/camera.jpg?raw=${$("boxes").checked ? 0 : 1}`);
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
