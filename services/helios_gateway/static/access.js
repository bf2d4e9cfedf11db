// Login with an API key, and selection of the robot.
import { $, element, robot, whenRefused } from "./api.js";

whenRefused(() => {
  if (!$("login").open) $("login").showModal();
});

$("change-key").addEventListener("click", () => $("login").showModal());

$("login-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const response = await fetch("/v1/session", {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ key: $("login-key").value }),
  }).catch(() => null);
  if (response?.ok) {
    location.reload();
    return;
  }
  const said = await response?.json().catch(() => ({}));
  $("login-error").textContent = said?.detail ?? "The gateway cannot be reached; try again.";
  $("login-error").hidden = false;
});

/** Shows the selection of robots if the gateway serves several. */
export async function showRobots() {
  const response = await fetch("/v1/robots");
  if (!response.ok) return;
  const { robots } = await response.json();
  $("robots-label").hidden = robots.length < 2;
  $("fleet-link").hidden = robots.length < 2;
  const chosen = robot ?? robots[0].name;
  $("robots").replaceChildren(
    ...robots.map(({ name }) => element("option", { value: name, textContent: name, selected: name === chosen })),
  );
}

$("robots").addEventListener("change", (event) => {
  location.search = `?robot=${encodeURIComponent(event.target.value)}`;
});
