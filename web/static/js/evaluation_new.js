/** The form that starts an evaluation: what it would cost is shown as it is filled in. */
import { ask, post, Refused } from "./api.js";
import { showCost, showNothing } from "./cost.js";

const form = /** @type {HTMLFormElement} */ (document.getElementById("new-evaluation"));
const steps = /** @type {HTMLElement} */ (document.querySelector(".steps"));
const button = /** @type {HTMLButtonElement} */ (document.getElementById("start"));
const alert = /** @type {HTMLElement} */ (document.querySelector("[data-alert]"));
const AFTER = 250; // ms without a change, before the cost is asked for
const AGAIN = 15000; // ms: others come and go
/** @type {number | undefined} */
let timer;
let asked = 0;

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  forget();
  button.disabled = true;
  try {
    const evaluation = await post("/api/v1/evaluations", wanted());
    location.assign(`/evaluations/${evaluation.id}`);
  } catch (error) {
    button.disabled = false;
    if (!(error instanceof Refused)) throw error;
    show(error);
  }
});
for (const kind of ["input", "change"]) {
  steps.addEventListener(kind, (event) => {
    const field = /** @type {HTMLInputElement} */ (event.target);
    if (field.form === form || field.name === "source") soon();
  });
}
addEventListener("pageshow", () => soon()); // a browser fills in what was there before
setInterval(() => document.hidden || estimate(), AGAIN);
estimate();

function soon() {
  clearTimeout(timer);
  timer = setTimeout(estimate, AFTER);
}

/** What the form asks for. @returns {Record<string, unknown>} */
function wanted() {
  const fields = new FormData(form);
  const category = String(fields.get("category") ?? "");
  /** @type {HTMLInputElement | null} */
  const chosen = form.querySelector("[name=category]:checked");
  const suite = chosen?.dataset.tasks?.split(" ") ?? null; // another suite's tasks
  const named = suite !== null || ["", "some", "smoke"].includes(category);
  const episodes = String(fields.get("episodes") ?? "");
  const smoke = category === "smoke";
  return {
    policy: fields.get("policy"),
    suite: smoke ? "smoke" : null,
    tasks: category === "some" ? fields.getAll("tasks") : suite,
    category: named ? null : category,
    ...(smoke ? {} : { split: fields.get("split") }),
    episodes: episodes && !smoke ? Number(episodes) : null,
    rules: fields.get("rules"),
    priority: Number(fields.get("priority") || 0),
    recordings: fields.get("recordings") !== null,
  };
}

/** Asks what it would cost, and shows that; what is wrong stands beside its field. */
async function estimate() {
  const number = ++asked;
  const asks = wanted();
  if (Array.isArray(asks.tasks) && !asks.tasks.length) {
    forget();
    return showNothing("Choose at least one task", button);
  }
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(asks)) {
    for (const one of Array.isArray(value) ? value : [value]) {
      if (one !== null && one !== "") query.append(name, String(one));
    }
  }
  try {
    const answer = await ask("GET", `/api/v1/evaluations/estimate?${query}`);
    const found = await answer.json();
    if (number !== asked) return;
    forget();
    showCost(found, button);
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    if (number !== asked) return;
    forget();
    showCost(null, button);
    show(error);
  }
}

/** @param {Refused} refused */
function show(refused) {
  const elsewhere = [];
  for (const { field, message } of refused.problem.errors ?? []) {
    const place = steps.querySelector(`[data-field="${CSS.escape(field.split(".")[0])}"]`);
    if (place) place.textContent = message;
    else elsewhere.push(`${field}: ${message}`);
    const named = form.elements.namedItem(field);
    if (named instanceof Element) named.setAttribute("aria-invalid", "true");
  }
  alert.textContent = [refused.message, ...elsewhere].join(" ");
  alert.hidden = false;
}

function forget() {
  alert.hidden = true;
  for (const field of form.elements) {
    field.removeAttribute("aria-invalid");
    const place = document.getElementById(field.getAttribute("aria-describedby") ?? "");
    if (place?.dataset.field) place.textContent = "";
  }
  for (const place of form.querySelectorAll("[data-field]")) place.textContent = "";
}
