/** The page of an episode: the viewer and the timeline in step, keys, the end of a live episode. */
import { Timeline } from "./timeline.js";
import { Replay } from "./viewer.js";

const root = /** @type {HTMLElement} */ (document.getElementById("episode"));
const place = document.getElementById("viewer");
const slider = document.getElementById("timeline");
const playButton = /** @type {HTMLButtonElement | null} */ (document.getElementById("play"));

const replay = place && new Replay(place);
const timeline = slider && new Timeline(slider, (seconds) => replay?.seek(seconds));

if (timeline) followDecisions(timeline);
if (replay) start(replay);
if (root.dataset.state !== "final") awaitEnd();
document.addEventListener("keydown", onKey);
for (const button of document.querySelectorAll("[data-seek]")) {
  button.addEventListener("click", () => goTo(Number(/** @type {HTMLElement} */ (button).dataset.seek)));
}
playButton?.addEventListener("click", () => replay?.play(!replay.playing));

/** @param {Replay} replay */
async function start(replay) {
  try {
    await replay.start({
      opened: () => playButton && (playButton.hidden = false),
      moved: (time, name) => timeline?.show(secondsOf(time, name)),
      played: (playing) => playButton && (playButton.textContent = playing ? "Pause" : "Play"),
    });
  } catch (error) {
    apologise(error);
  }
}

/** Simulated seconds of a viewer's time. @param {number} time @param {string} name */
function secondsOf(time, name) {
  if (name === "decision") return timeline?.moments[Math.min(time, timeline.moments.length - 1)] ?? 0;
  return time / 1e9;
}

/** @param {unknown} error */
function apologise(error) {
  const message = /** @type {HTMLElement} */ (document.getElementById("no-viewer"));
  /** @type {HTMLElement} */ (message.querySelector(".why")).textContent = String(error);
  message.hidden = false;
  if (place) place.hidden = true;
}

/** @param {number} seconds */
function goTo(seconds) {
  timeline?.go(seconds);
  const box = place?.getBoundingClientRect();
  if (box && (box.bottom < 80 || box.top > innerHeight - 80)) place?.scrollIntoView({ behavior: "smooth" });
}

/** Mark the row of the decision that is under way. @param {Timeline} timeline */
function followDecisions(timeline) {
  const now = /** @type {HTMLElement} */ (document.getElementById("now"));
  timeline.slider.addEventListener("moved", () => {
    now.textContent = `${timeline.seconds.toFixed(2)}\u202fs`;
    document.querySelector("tr.now")?.classList.remove("now");
    document.querySelector(`tr[data-decision="${timeline.decision}"]`)?.classList.add("now");
  });
}

/** @param {KeyboardEvent} event */
function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
  const target = /** @type {HTMLElement} */ (event.target);
  if (target.closest("input, select, textarea, canvas")) return;
  if (event.key === "p" || event.key === "n") {
    const way = event.key === "p" ? "prev" : "next";
    /** @type {HTMLAnchorElement | null} */ (document.querySelector(`.neighbours [rel=${way}]`))?.click();
  } else if (event.key === " " && target.closest("#timeline, body") && !target.closest("a, button, summary")) {
    event.preventDefault();
    replay?.play(!replay.playing);
  } else if ((event.key === "ArrowLeft" || event.key === "ArrowRight") && target === document.body) {
    slider?.dispatchEvent(new KeyboardEvent("keydown", { key: event.key, shiftKey: event.shiftKey }));
    event.preventDefault();
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
