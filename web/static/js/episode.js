/** The page of an episode: viewer, timelines, pictures and memory in step; keys; the end of a live episode. */
import { Beside } from "./beside.js";
import { offerCopies } from "./copy.js";
import { Large, Pictures } from "./pictures.js";
import { Player } from "./player.js";
import { Timeline } from "./timeline.js";
import { Replay } from "./viewer.js";

const root = /** @type {HTMLElement} */ (document.getElementById("episode"));
const place = document.getElementById("viewer");
const slider = document.getElementById("timeline");
const others = document.getElementById("beside-run");
const steps = /** @type {HTMLElement | null} */ (document.querySelector(".steps"));
const help = /** @type {HTMLDialogElement} */ (document.getElementById("help"));

const replay = place && new Replay(place);
const timeline = slider && new Timeline(slider, (seconds) => sought(seconds));
const player = timeline && new Player(timeline, replay);
const pictures = new Pictures(root.dataset.id ?? "");
const large = new Large(root.dataset.id ?? "", (way) => timeline?.step(way));
const beside = timeline && others && new Beside(others, timeline);
/** @type {ReturnType<typeof setTimeout> | undefined} */
let keeping;

if (timeline) follow(timeline);
if (replay) start(replay);
if (root.dataset.state !== "final") awaitEnd();
offerCopies();
document.addEventListener("keydown", onKey);
document.addEventListener("click", onClick);

/** The reader moved the slider. @param {number} seconds */
function sought(seconds) {
  player?.stop();
  replay?.seek(seconds, timeline?.decision ?? 0);
}

/** @param {Replay} replay */
async function start(replay) {
  try {
    await replay.start({
      moved: (time, name) => player?.moved(...momentOf(time, name)),
      played: (playing) => player?.told(playing),
    });
  } catch (error) {
    apologise(error);
  }
}

/**
 * Simulated seconds of a viewer's time, and the decision where that is known.
 * @param {number} time @param {string} name @returns {[number, number?]}
 */
function momentOf(time, name) {
  if (name !== "decision" || !timeline) return [time / 1e9];
  const decision = Math.min(time, timeline.moments.length - 1);
  return [timeline.moments[decision], decision];
}

/** @param {unknown} error */
function apologise(error) {
  const message = /** @type {HTMLElement} */ (document.getElementById("no-viewer"));
  /** @type {HTMLElement} */ (message.querySelector(".why")).textContent = String(error);
  message.hidden = false;
  if (place) place.hidden = true;
  document.querySelector(".replay")?.classList.add("without");
}

/** Show on the page where the timeline is. @param {Timeline} timeline */
function follow(timeline) {
  let known = -1;
  timeline.slider.addEventListener("moved", () => {
    write("time", `${timeline.seconds.toFixed(2)}\u202fs`);
    beside?.follow();
    if (timeline.decision === known) return;
    known = timeline.decision;
    arrive(known);
  });
  steps?.addEventListener("click", step);
  if (steps) steps.querySelectorAll("[hidden]").forEach((one) => one.removeAttribute("hidden"));
  const at = Number(root.dataset.at);
  timeline.go(timeline.moments[at] ?? 0, at);
}

/** Another decision is shown. @param {number} decision */
function arrive(decision) {
  const last = Number(steps?.dataset.last);
  const named = decision < last ? `decision ${decision} of ${last}` : "the end";
  write("now", named);
  tell(document.querySelector(`#decisions tr[data-decision="${decision}"]`));
  write("memory-of", decision < last ? `decision ${decision}` : "its last action");
  for (const row of document.querySelectorAll("tr[data-decision]")) {
    row.classList.toggle("now", row.getAttribute("data-decision") === `${decision}`);
  }
  remember(decision);
  pictures.show(decision, beside?.decision ?? decision, last);
  large.show(decision, named);
  takeAlong(decision);
  keepPlace(decision);
}

/** Setting a run beside this one, or showing it alone, leads to the same decision. @param {number} decision */
function takeAlong(decision) {
  const input = /** @type {HTMLInputElement | null} */ (document.getElementById("compare-at"));
  if (input) Object.assign(input, { value: `${decision}`, disabled: !decision });
  const alone = /** @type {HTMLAnchorElement | null} */ (document.querySelector("a#compare"));
  if (!alone) return;
  const address = new URL(alone.href);
  if (decision) address.searchParams.set("at", `${decision}`);
  else address.searchParams.delete("at");
  alone.href = address.href;
}

/** @param {number} decision */
function remember(decision) {
  const stated = document.querySelector(`[data-memory="${decision}"]`);
  for (const one of document.querySelectorAll("[data-memory]")) {
    const shown = stated ? one === stated : one.getAttribute("data-memory") === "none";
    one.toggleAttribute("hidden", !shown);
  }
}

/** The address leads to where the reader is; browsers allow few changes a second. @param {number} decision */
function keepPlace(decision) {
  clearTimeout(keeping);
  keeping = setTimeout(() => {
    const address = new URL(location.href);
    if (decision || address.searchParams.has("at")) address.searchParams.set("at", `${decision}`);
    if (address.href !== location.href) history.replaceState(null, "", address);
  }, 300);
}

/** @param {MouseEvent} event */
function step(event) {
  const link = /** @type {HTMLElement} */ (event.target).closest("a");
  if (!link || event.metaKey || event.ctrlKey || event.shiftKey) return;
  event.preventDefault();
  timeline?.step(link.id === "step-on" ? 1 : -1);
}

/** @param {MouseEvent} event */
function onClick(event) {
  const target = /** @type {HTMLElement} */ (event.target);
  const seek = /** @type {HTMLElement | null} */ (target.closest("[data-seek]"));
  const camera = /** @type {HTMLElement | null} */ (target.closest("button.camera"));
  if (camera) large.open(camera.dataset.camera);
  else if (target.closest("#help-button")) help.showModal();
  else if (target.closest("#play")) player?.toggle();
  else if (seek && !("leave" in seek.dataset) && !event.metaKey && !event.ctrlKey) {
    event.preventDefault();
    timeline?.go(Number(seek.dataset.seek), Number(seek.dataset.number));
  }
}

/** @param {KeyboardEvent} event */
function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
  const target = /** @type {HTMLElement} */ (event.target);
  if (target.closest("input, select, textarea, canvas")) return;
  if (pressed(event, target)) event.preventDefault();
}

/** True if the key means something here. @param {KeyboardEvent} event @param {HTMLElement} target */
function pressed({ key, shiftKey }, target) {
  const way = { ArrowLeft: -1, ArrowRight: 1 }[key];
  if (way) return timeline && !target.closest(".scroll") ? timeline.step(way, shiftKey) : false;
  if (key === " ") return target.closest("a, button, summary") ? false : (player?.toggle(), Boolean(player));
  if (key === "?") return help.open || help.showModal(), true;
  if (large.dialog.open && key >= "1" && key <= "4") return large.choose(Number(key) - 1), true;
  if (key === "o") return large.open(), true;
  const followed = { p: ".neighbours [rel=prev]", n: ".neighbours [rel=next]", c: "#compare" }[key];
  if (!followed || document.querySelector("dialog[open]")) return false;
  /** @type {HTMLAnchorElement | null} */ (document.querySelector(followed))?.click();
  return true;
}

/** @param {string} id @param {string} text */
function write(id, text) {
  const there = document.getElementById(id);
  if (there) there.textContent = text;
}

/** What the decision did, as its row says it; of none, nothing. @param {Element | null} row */
function tell(row) {
  write("doing", row?.querySelector("[data-fact=action]")?.textContent ?? "");
  for (const fact of document.querySelectorAll("dd[data-fact]")) {
    const cell = row?.querySelector(`[data-fact=${fact.getAttribute("data-fact")}]`);
    fact.textContent = cell ? (cell.getAttribute("data-whole") ?? cell.textContent) : "–";
  }
}

/** Tell when an episode that is being played is over. */
function awaitEnd() {
  const { evaluation, lastEvent, id, state } = root.dataset;
  const source = new EventSource(`/api/v1/evaluations/${evaluation}/events?after=${lastEvent}`);
  source.addEventListener("episode", (event) => {
    const episode = JSON.parse(event.data);
    if (episode.id !== id || episode.state === state) return;
    if (episode.state === "running" && !place) location.reload();
    if (episode.state !== "final") return;
    source.close();
    /** @type {HTMLElement} */ (document.getElementById("over")).hidden = false;
  });
  source.addEventListener("evaluation", (event) => {
    if (["completed", "incomplete", "cancelled"].includes(JSON.parse(event.data).state)) source.close();
  });
  addEventListener("pagehide", () => source.close());
}
