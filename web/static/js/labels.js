/** Labels and notes of episodes: added, taken back; the macro of labels.html is their place. */
import { Refused, post } from "./api.js";

/**
 * @typedef {{id: string, episode: string, label: string | null, note: string, author: string}} Label
 */

const LABEL = /^[a-z0-9][a-z0-9_.:-]{0,79}$/; // as the ledger takes it
const WRONG = "A label is small letters, digits and . _ : - alone.";

/** Bring the labels of a page to life. @param {ParentNode} [within] */
export function start(within = document) {
  for (const place of /** @type {NodeListOf<HTMLElement>} */ (within.querySelectorAll("[data-labels]"))) {
    place.addEventListener("click", (event) => onClick(place, event));
    place.querySelector("form")?.addEventListener("submit", (event) => onSubmit(place, event));
    place.addEventListener("keydown", (event) => event.key === "Escape" && close(place));
  }
}

/**
 * Say something of an episode, and show it wherever the page has the episode's labels.
 * @param {string} episode
 * @param {{label?: string | null, note?: string}} what
 * @throws {Refused}
 */
export async function add(episode, what) {
  if (what.label && !LABEL.test(what.label)) throw new Refused({ title: WRONG, status: 422 });
  /** @type {Label} */
  const added = await post(`/api/v1/episodes/${encodeURIComponent(episode)}/labels`, what);
  for (const place of document.querySelectorAll(`[data-labels="${CSS.escape(episode)}"] .said`)) {
    place.append(item(added));
  }
  offer(added.label);
}

/** What is written in small letters, without spaces. @param {string} written */
export function labelOf(written) {
  return written.trim().toLowerCase().replaceAll(/\s+/g, "-") || null;
}

/** What a refusal says to people. @param {unknown} error */
export function reason(error) {
  if (!(error instanceof Refused)) throw error;
  return error.message;
}

/** @param {HTMLElement} place @param {Event} event */
async function onClick(place, event) {
  const button = /** @type {HTMLElement} */ (event.target).closest("button.withdraw");
  const said = /** @type {HTMLElement | null} */ (button?.closest("[data-label]") ?? null);
  if (!said) return;
  try {
    await post(`/api/v1/labels/${said.dataset.label}/withdrawal`);
  } catch (error) {
    said.title = reason(error);
    return;
  }
  said.remove();
  /** @type {HTMLElement | null} */ (place.querySelector("summary"))?.focus();
}

/** @param {HTMLElement} place @param {SubmitEvent} event */
async function onSubmit(place, event) {
  event.preventDefault();
  const form = /** @type {HTMLFormElement} */ (event.target);
  const error = /** @type {HTMLElement} */ (form.querySelector(".error"));
  const sent = new FormData(form);
  error.textContent = "";
  try {
    await add(String(place.dataset.labels), {
      label: labelOf(String(sent.get("label"))),
      note: String(sent.get("note")).trim(),
    });
  } catch (refused) {
    error.textContent = reason(refused);
    return;
  }
  form.reset();
  close(place);
}

/** @param {HTMLElement} place */
function close(place) {
  const details = place.querySelector("details");
  if (!details?.open) return;
  details.open = false;
  details.querySelector("summary")?.focus();
}

/** The same as the macro writes. @param {Label} said */
function item(said) {
  const li = document.createElement("li");
  li.dataset.label = said.id;
  li.title = `${said.author}, now`;
  if (said.label) {
    const link = Object.assign(document.createElement("a"), { className: "label", textContent: said.label });
    link.href = `/failures?${new URLSearchParams({ label: said.label, verdict: "all" })}`;
    li.append(link);
  }
  if (said.note) {
    const note = document.createElement("q");
    note.textContent = said.note;
    const author = Object.assign(document.createElement("small"), { className: "muted", textContent: said.author });
    li.append(note, " ", author);
  }
  const back = Object.assign(document.createElement("button"), { type: "button", className: "withdraw", textContent: "×" });
  back.setAttribute("aria-label", `Take back ${said.label ?? "the note"}`);
  li.append(back);
  return li;
}

/** Offer a new label while the next one is typed. @param {string | null} label */
function offer(label) {
  const known = document.getElementById("known-labels");
  if (!label || !known || known.querySelector(`[value="${CSS.escape(label)}"]`)) return;
  known.append(Object.assign(document.createElement("option"), { value: label }));
}
