// Client of the HTTP API, and small helpers for the page.

/** A refusal of the gateway, with the status of its response. */
export class Problem extends Error {
  constructor(message, status = 0) {
    super(message);
    this.status = status;
  }
}

export const robot = new URLSearchParams(location.search).get("robot");
const base = robot === null ? "/v1" : `/v1/robots/${encodeURIComponent(robot)}`;

let onRefused = () => {};
/** Sets `handle`, which is called when a request needs a key, or another one. */
export const whenRefused = (handle) => (onRefused = handle);

/** Full address of a path below the root of the selected robot. */
export const address = (path) => base + path;

/** Response of the API. `path` is below the root of the selected robot. */
export async function get(path, options = {}) {
  const response = await fetch(base + path, options);
  if (response.status === 401) onRefused();
  if (response.status === 403) $("change-key").hidden = false; // another key may be allowed to
  return response;
}

/** JSON response. Throws Problem with the server's detail, TypeError without a connection. */
export async function ask(path, options = {}) {
  const response = await get(path, options);
  const body = await response.json().catch(() => ({}));
  if (!response.ok) throw new Problem(body.detail ?? `${path} answered ${response.status}`, response.status);
  return body;
}

export const send = (path, body, options = {}) =>
  ask(path, {
    ...options,
    method: "POST",
    headers: { "content-type": "application/json" },
    body: body === undefined ? undefined : JSON.stringify(body),
  });

/** Passes events to the handler of their type until the page closes; reconnects by itself. */
export function listen(handlers, onOpen, onLost) {
  let source;
  const open = () => {
    source = new EventSource(`${base}/events`);
    source.onopen = onOpen;
    source.onerror = () => {
      onLost();
      ask("/status").catch(() => {}); // opens the login if a key is required
      if (source.readyState === EventSource.CLOSED) setTimeout(open, 2000);
    };
    for (const [type, handle] of Object.entries(handlers)) {
      source.addEventListener(type, (event) => handle(JSON.parse(event.data)));
    }
  };
  open();
}

/** Function that runs `work`, never concurrently; calls during a run cause one more run. */
export function coalesced(work) {
  let running = false;
  let again = false;
  return async function run() {
    if (running) {
      again = true;
      return;
    }
    running = true;
    try {
      await work();
    } catch (error) {
      if (!(error instanceof Problem || error instanceof TypeError)) throw error;
    } finally {
      running = false;
      if (again) {
        again = false;
        run();
      }
    }
  };
}

export const $ = (id) => document.getElementById(id);

export function element(tag, properties = {}, ...children) {
  const out = Object.assign(document.createElement(tag), properties);
  out.append(...children);
  return out;
}

export const number = (value, digits = 2) => (value == null ? "–" : value.toFixed(digits));
export const words = (name) => name.replaceAll("_", " ");

export function facts(list, pairs) {
  list.replaceChildren(
    ...pairs
      .filter(([, value]) => value !== "" && value != null)
      .map(([name, value]) =>
        element("div", {}, element("dt", { textContent: name }), element("dd", { textContent: value })),
      ),
  );
}
