/** Keeps the part of an evaluation's page up to date that the server draws: lanes, log, what plays. */

const PARTS = ["live-started", "live-now", "live-rest"];
const OFTEN = 1500; // ms between two looks while something happens
const SELDOM = 6000; // ms between two while nothing does: what runs grows longer
const AT_END = 40; // pixels from the log's end that count as being there

/**
 * Begins to look; what it gives is called when something has happened.
 * @param {string} address
 * @returns {() => void}
 */
export function keepLive(address) {
  let looking = false;
  /** @type {number | undefined} */
  let timer;
  let due = Infinity;

  /** @param {number} wait */
  function plan(wait) {
    const at = Date.now() + wait;
    if (at >= due || looking) return;
    due = at;
    clearTimeout(timer);
    timer = setTimeout(look, wait);
  }

  async function look() {
    due = Infinity;
    if (!document.hidden) {
      looking = true;
      const answer = await fetch(address).catch(() => null);
      if (answer?.ok) show(await answer.text());
      looking = false;
    }
    plan(SELDOM);
  }

  scrollLog();
  plan(SELDOM);
  return () => plan(OFTEN);
}

/** @param {string} html of our own server, escaped there */
function show(html) {
  const fresh = new DOMParser().parseFromString(html, "text/html");
  const log = document.querySelector("[data-log]");
  const at = log && log.scrollTop;
  const following = !log || log.scrollHeight - log.scrollTop - log.clientHeight < AT_END;
  const open = document.querySelector(".waits")?.hasAttribute("open");
  for (const id of PARTS) replace(document.getElementById(id), fresh.getElementById(id));
  if (open !== undefined) document.querySelector(".waits")?.toggleAttribute("open", open);
  if (following) scrollLog();
  else /** @type {HTMLElement} */ (document.querySelector("[data-log]")).scrollTop = at ?? 0;
}

/** Replaces a part; what had the keyboard's focus keeps it. @param {HTMLElement | null} old @param {HTMLElement | null} fresh */
function replace(old, fresh) {
  if (!old || !fresh) return;
  const here = document.activeElement;
  const focused = here && old.contains(here) ? selectorOf(here) : null;
  old.replaceWith(fresh);
  if (focused) /** @type {HTMLElement | null} */ (fresh.querySelector(focused))?.focus({ preventScroll: true });
}

/** What finds an element again after the part was replaced. @param {Element} element */
function selectorOf(element) {
  const link = element.getAttribute("href");
  if (link) return `${element.className ? `.${element.classList[0]}` : ""}[href="${CSS.escape(link)}"]`;
  return element.hasAttribute("data-log") ? "[data-log]" : "summary";
}

/** To the newest line. */
export function scrollLog() {
  const log = document.querySelector("[data-log]");
  if (log) log.scrollTop = log.scrollHeight;
}
