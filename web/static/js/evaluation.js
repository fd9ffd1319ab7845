/** Keeps the page of an evaluation up to date by the server's events; without it a reload does. */
import { post, Refused } from "./api.js";
import { keepLive, scrollLog } from "./live.js";

const root = /** @type {HTMLElement} */ (document.getElementById("evaluation"));
const address = `/api/v1/evaluations/${root.dataset.id}`;
const alert = /** @type {HTMLElement} */ (root.querySelector("[role=alert]"));
const RELOAD_AFTER = 1500; // ms: enough to see the last cell change

for (const button of root.querySelectorAll("[data-send]")) {
  button.addEventListener("click", () => send(/** @type {HTMLButtonElement} */ (button)));
}
if (root.dataset.ended === "no") watch();
scrollLog();

/** @param {HTMLButtonElement} button */
async function send(button) {
  if (button.dataset.confirm && !confirm(button.dataset.confirm)) return;
  button.disabled = true;
  alert.hidden = true;
  try {
    const answer = await post(`${address}/${button.dataset.send}`);
    if (button.dataset.then) location.assign(button.dataset.then + answer.number);
    else location.reload();
  } catch (error) {
    button.disabled = false;
    if (!(error instanceof Refused)) throw error;
    alert.textContent = error.message;
    alert.hidden = false;
  }
}

function watch() {
  const source = new EventSource(`${address}/events?after=${root.dataset.lastEvent}`);
  /** @type {(name: string, handle: (data: any) => void) => void} */
  const on = (name, handle) =>
    source.addEventListener(name, (event) => handle(JSON.parse(event.data)));
  const stirred = keepLive(`/evaluations/${root.dataset.id}/live`);
  for (const name of ["episode", "attempt", "fault", "evaluation"]) on(name, stirred);
  on("episode", showEpisode);
  on("progress", showProgress);
  on("attempt", showAttempt);
  on("evaluation", ({ state, reason }) => {
    showState(state, reason);
    if (!["completed", "incomplete", "cancelled"].includes(state)) return;
    source.close();
    setTimeout(() => location.reload(), RELOAD_AFTER);
  });
  addEventListener("pagehide", () => source.close());
}

/** @param {{id: string, task: string, index: number, state: string, success: boolean | null, exact: boolean | null, failure: string | null}} episode */
function showEpisode(episode) {
  const cell = document.getElementById(`cell-${episode.id}`);
  if (!cell) return;
  const kind = kindOf(episode);
  const said = { exact: "exact", success: "success, not exact" }[kind] ?? kind;
  const why = episode.failure ? `, ${episode.failure.replaceAll("_", " ")}` : "";
  cell.className = `cell ${kind}`;
  cell.title = `Episode ${episode.index}: ${said}${why}`;
  cell.setAttribute("aria-label", cell.title);
  showTask(/** @type {HTMLElement} */ (cell.closest("[data-task]")));
  showTask(/** @type {HTMLElement} */ (cell.closest("[data-kind]")));
}

/** @param {{state: string, success: boolean | null, exact: boolean | null}} episode */
function kindOf({ state, success, exact }) {
  if (state !== "final") return state;
  return exact ? "exact" : success ? "success" : "failed";
}

/** The running rates of a task, counted from its cells. @param {HTMLElement} row */
function showTask(row) {
  /** @param {string} kinds */
  const count = (kinds) => row.querySelectorAll(kinds).length;
  const episodes = count(".cell.exact, .cell.success, .cell.failed");
  const exact = count(".cell.exact");
  showRate(row.querySelector('[data-task-rate="success"]'), rate(exact + count(".cell.success"), episodes));
  showRate(row.querySelector('[data-task-rate="exact"]'), rate(exact, episodes));
}

/**
 * @typedef {{episodes: number, value: number | null, low: number, high: number}} Rate
 * @typedef {{expected: number, final: number, running: number, per_minute: number | null, seconds_left: number | null}} Progress
 */

/** A rate with its 95 % Wilson interval. @returns {Rate} @param {number} successes @param {number} episodes */
export function rate(successes, episodes) {
  if (!episodes) return { episodes, value: null, low: 0, high: 1 };
  const z = 1.959963984540054;
  const value = successes / episodes;
  const shrink = 1 + (z * z) / episodes;
  const centre = (value + (z * z) / (2 * episodes)) / shrink;
  const half = (z * Math.sqrt((value * (1 - value)) / episodes + (z / (2 * episodes)) ** 2)) / shrink;
  return {
    episodes,
    value,
    low: successes ? centre - half : 0,
    high: successes < episodes ? centre + half : 1,
  };
}

/** @param {Element | null} place @param {Rate} found */
function showRate(place, found) {
  if (!place) return;
  const text = found.value === null ? "–" : `${Math.round(100 * found.value)}\u202f%`;
  /** @type {HTMLElement} */ (place.querySelector("b")).textContent = text;
  const svg = /** @type {SVGElement} */ (place.querySelector("svg"));
  const bar = svg.querySelector(".bar") ?? added(svg, "rect", { class: "bar", height: "100%" });
  const whisker = svg.querySelector(".whisker") ?? added(svg, "line", { class: "whisker", y1: "4", y2: "4" });
  bar.setAttribute("width", `${100 * (found.value ?? 0)}%`);
  whisker.setAttribute("x1", `${100 * found.low}%`);
  whisker.setAttribute("x2", `${100 * found.high}%`);
  const small = /** @type {HTMLElement} */ (place.querySelector(".rate small"));
  const interval = document.createElement("span");
  interval.className = "interval";
  interval.textContent = `${Math.round(100 * found.low)}–${Math.round(100 * found.high)}`;
  small.replaceChildren(...(found.value === null ? [] : [interval, " "]), `n ${found.episodes}`);
}

/** @param {SVGElement} svg @param {string} name @param {Record<string, string>} attributes */
function added(svg, name, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return svg.appendChild(made);
}

/** @param {{progress: Progress, verdicts: {success: Rate & {successes: number}, exact: Rate & {successes: number}}}} data */
function showProgress({ progress, verdicts }) {
  showRate(root.querySelector('[data-rate="success"]'), verdicts.success);
  showRate(root.querySelector('[data-rate="exact"]'), verdicts.exact);
  /** @type {HTMLElement} */ (root.querySelector('[data-progress="final"]')).textContent = String(progress.final);
  const pace = /** @type {HTMLElement} */ (root.querySelector('[data-progress="pace"]'));
  const speed = progress.per_minute === null ? "" : `, ${progress.per_minute.toFixed(0)} a minute`;
  const left = progress.seconds_left === null ? "" : `, ${duration(progress.seconds_left)} left`;
  pace.textContent = speed + left;
  const { exact, success } = verdicts;
  const parts = [exact.successes, success.successes - exact.successes, success.episodes - success.successes, progress.running];
  const bars = root.querySelectorAll('[data-progress="bar"] rect:not(.track)');
  let at = 0;
  bars.forEach((bar, number) => {
    bar.setAttribute("x", `${(100 * at) / progress.expected}%`);
    bar.setAttribute("width", `${(100 * parts[number]) / progress.expected}%`);
    at += parts[number];
  });
  root.querySelector('[data-progress="bar"] svg')?.setAttribute("aria-label", `${progress.final} of ${progress.expected} episodes`);
}

/** @param {number} seconds */
function duration(seconds) {
  if (seconds < 60) return `${seconds.toFixed(0)}\u202fs`;
  const minutes = Math.floor(seconds / 60);
  if (minutes < 10) return `${minutes}\u202fmin ${String(Math.floor(seconds % 60)).padStart(2, "0")}\u202fs`;
  return minutes < 60 ? `${minutes}\u202fmin` : `${Math.floor(minutes / 60)}\u202fh ${String(minutes % 60).padStart(2, "0")}\u202fmin`;
}

/** @param {string} state @param {string | null} reason */
function showState(state, reason) {
  const badge = /** @type {HTMLElement} */ (document.querySelector("#state .state"));
  badge.className = `state ${state}`;
  badge.textContent = state;
  document.title = document.title.replace(/^.*(?= · )/, `${root.dataset.policy}, ${state}`);
  const place = /** @type {HTMLElement} */ (document.getElementById("reason"));
  place.textContent = reason ?? "";
  place.hidden = !reason;
  /** @type {HTMLElement} */ (document.getElementById("spoken")).textContent = `The evaluation is ${state}.`;
}

/** @param {{task: string, fence: number, state: string, reason: string | null}} attempt */
function showAttempt({ task, fence, state, reason }) {
  if (state !== "lost") return;
  const section = /** @type {HTMLElement} */ (document.getElementById("lost"));
  const row = /** @type {HTMLTableSectionElement} */ (section.querySelector("tbody")).insertRow(0);
  for (const text of [task, String(fence), reason ?? "–", "", "just now"]) row.insertCell().textContent = text;
  section.hidden = false;
}
