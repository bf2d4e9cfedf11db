// Stop-now and clear-stop. Loads before the other scripts, whose errors cannot block it.
import { $, Problem, send } from "./api.js";

const COMMANDS = {
  "stop": {
    doing: "Stopping…",
    within_ms: 3000, // the gateway waits one second for the bridge
    failed: "The stop did not get through",
    late: "It is not known whether the robot stops",
    instead: "Press again, or use the switch on the robot.",
  },
  "clear-stop": {
    doing: "Clearing…",
    within_ms: 8000,
    failed: "Not cleared",
    late: "It is not known whether the stop is lifted",
    instead: "",
  },
};

/** Shows if the robot is stopped, and the reason. */
export function showStopped(stopped, why) {
  const reason = why ? ` (${why})` : "";
  $("stopped").textContent = `The robot is stopped${reason}: it will not move until you clear the stop.`;
  $("stopped").hidden = !stopped;
  $("clear-stop").hidden = !stopped;
}

async function press(id) {
  const { doing, within_ms, failed, late, instead } = COMMANDS[id];
  const button = $(id);
  $("failed").hidden = true;
  button.textContent = doing;
  button.setAttribute("aria-busy", "true"); // never disabled: a second press must work
  try {
    const { state } = await send(`/robot/${id}`, undefined, { signal: AbortSignal.timeout(within_ms) });
    if (state) showStopped(state.stopped, state.message);
  } catch (error) {
    const why = error instanceof Problem ? error.message.replace(/\.$/, "")
      : error.name === "TimeoutError" ? `no answer came within ${within_ms / 1000} s`
      : "the gateway cannot be reached";
    $("failed").textContent = `${error.name === "TimeoutError" ? late : failed}: ${why}. ${instead}`;
    $("failed").hidden = false;
  } finally {
    button.textContent = button.dataset.label;
    button.removeAttribute("aria-busy");
  }
}

for (const id of Object.keys(COMMANDS)) {
  $(id).dataset.label = $(id).textContent;
  $(id).addEventListener("click", () => press(id));
}
