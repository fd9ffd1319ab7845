/** The page of failures: keys between cards, previews, labels, views. */
import * as labels from "./labels.js";
import * as previews from "./previews.js";
import * as selection from "./selection.js";
import * as views from "./views.js";

labels.start();
previews.start();
selection.start();
views.start();

const search = /** @type {HTMLInputElement} */ (document.getElementById("search"));
const keys = /** @type {HTMLDialogElement} */ (document.getElementById("keys"));
const links = /** @type {HTMLAnchorElement[]} */ ([...document.querySelectorAll(".card a.to")]);

document.addEventListener("keydown", onKey);
document.addEventListener("click", closeMenus);

/** The card that has the focus. */
function current() {
  return document.activeElement?.closest(".card") ?? null;
}

/** Go so many cards further. @param {number} step */
function move(step) {
  const at = links.findIndex((link) => link.closest(".card") === current());
  const next = at < 0 ? 0 : Math.min(Math.max(at + step, 0), links.length - 1);
  links[next]?.focus();
  links[next]?.closest(".card")?.scrollIntoView({ block: "nearest" });
}

/** Cards side by side. */
function columns() {
  const tops = links.map((link) => link.closest(".card")?.getBoundingClientRect().top);
  return Math.max(tops.filter((top) => top === tops[0]).length, 1);
}

/** @type {Record<string, () => void>} */
const ANYWHERE = {
  j: () => move(1),
  k: () => move(-1),
  n: () => follow("next"),
  p: () => follow("prev"),
  x: () => {
    const card = current();
    if (card) selection.toggle(card);
  },
  l: () => label(),
  "/": () => search.focus(),
  "?": () => keys.showModal(),
};
/** @type {Record<string, () => void>} */
const ON_A_CARD = {
  ArrowRight: () => move(1),
  ArrowLeft: () => move(-1),
  ArrowDown: () => move(columns()),
  ArrowUp: () => move(-columns()),
};

/** @param {"next" | "prev"} way */
function follow(way) {
  /** @type {HTMLAnchorElement | null} */ (document.querySelector(`.pages [rel=${way}]`))?.click();
}

function label() {
  const details = current()?.querySelector("details");
  if (!details) return;
  details.open = true;
  details.querySelector("input")?.focus();
}

/** @param {KeyboardEvent} event */
function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
  const target = /** @type {HTMLElement} */ (event.target);
  if (event.key === "Escape") return leave(target);
  if (keys.open || target.closest("input:not([type=checkbox]), select, textarea")) return;
  const act = ANYWHERE[event.key] ?? (target.closest(".card") && ON_A_CARD[event.key]);
  if (!act) return;
  event.preventDefault();
  act();
}

/** @param {HTMLElement} target */
function leave(target) {
  if (target === search) search.blur();
  const menu = target.closest("details.menu");
  if (!(menu instanceof HTMLDetailsElement)) return;
  menu.open = false;
  menu.querySelector("summary")?.focus();
}

/** A menu closes when something else is clicked. @param {MouseEvent} event */
function closeMenus(event) {
  for (const menu of /** @type {NodeListOf<HTMLDetailsElement>} */ (document.querySelectorAll("details.menu[open]"))) {
    if (!menu.contains(/** @type {Node} */ (event.target))) menu.open = false;
  }
}
