// State of each service, and the reasons why the robot cannot do a task.
import { $, element } from "./api.js";

const ORDER = ["router", "world", "bridge", "detector", "objectmap", "map2d", "planner", "gateway"];
const services = new Map();

export function showService(service) {
  services.set(service.name, service);
  const place = ({ name }) => (ORDER.indexOf(name) + ORDER.length + 1) % (ORDER.length + 1);
  const inOrder = [...services.values()].sort((a, b) => place(a) - place(b));
  $("services").replaceChildren(...inOrder.map(row));
}

function row({ name, state, reason, restarts, pid }) {
  const dot = element("span", { className: "dot" });
  dot.ariaHidden = "true";
  const out = element(
    "li",
    { title: pid ? `process ${pid}` : "" },
    dot,
    element("span", { textContent: name }),
    element("span", { className: "state", textContent: state }),
    element("span", {
      className: "restarts",
      textContent: restarts ? `${restarts} restart${restarts === 1 ? "" : "s"}` : "",
    }),
    element("span", { className: "reason", textContent: reason.startsWith("http") ? "" : reason }),
  );
  out.dataset.name = name;
  out.dataset.state = state;
  return out;
}

export function showReady({ ready, stopped, reasons }) {
  $("ready").textContent = ready ? "ready" : stopped ? "stopped" : "not ready";
  $("ready").dataset.state = ready ? "ready" : stopped ? "failed" : "waiting";
  const inTheWay = reasons.filter((reason) => !reason.startsWith("the robot is stopped"));
  $("trouble").textContent = inTheWay.join(" · ");
  $("trouble").hidden = !inTheWay.length;
}
