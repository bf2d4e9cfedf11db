// Stop-now and clear-stop. Loads before the other scripts, whose errors cannot block it.
import { $, send } from "./api.js";
import { COMMANDS, whyNot } from "./commands.js";

/** Shows if the robot is stopped, and the reason. */
export function showStopped(stopped, why) {
  const reason = why ? ` (${why})` : "";
  $("stopped").textContent = `The robot is stopped${reason}: it will not move until you clear the stop.`;
  $("stopped").hidden = !stopped;
  $("clear-stop").hidden = !stopped;
}

async function press(id) {
  const { doing, within_ms } = COMMANDS[id];
  const button = $(id);
  $("failed").hidden = true;
  button.textContent = doing;
  button.setAttribute("aria-busy", "true"); // never disabled: a second press must work
  try {
    const { state } = await send(`/robot/${id}`, undefined, { signal: AbortSignal.timeout(within_ms) });
    if (state) showStopped(state.stopped, state.message);
  } catch (error) {
    $("failed").textContent = whyNot(id, error);
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
