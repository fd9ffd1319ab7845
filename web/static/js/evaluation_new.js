/** The form that starts an evaluation: what it asks for is sent as JSON, errors stand beside it. */
import { post, Refused } from "./api.js";

const form = /** @type {HTMLFormElement} */ (document.getElementById("new-evaluation"));
const button = /** @type {HTMLButtonElement} */ (form.querySelector("[type=submit]"));
const alert = /** @type {HTMLElement} */ (form.querySelector("[role=alert]"));

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  forget();
  button.disabled = true;
  try {
    const evaluation = await post("/api/v1/evaluations", asked(new FormData(form)));
    location.assign(`/evaluations/${evaluation.id}`);
  } catch (error) {
    button.disabled = false;
    if (!(error instanceof Refused)) throw error;
    show(error);
  }
});

/**
 * @param {FormData} fields
 * @returns {Record<string, unknown>}
 */
function asked(fields) {
  const category = String(fields.get("category") ?? "");
  const some = category === "some";
  const episodes = String(fields.get("episodes") ?? "");
  return {
    policy: fields.get("policy"),
    tasks: some ? fields.getAll("tasks") : null,
    category: some || !category ? null : category,
    split: fields.get("split"),
    episodes: episodes ? Number(episodes) : null,
    rules: fields.get("rules"),
    priority: Number(fields.get("priority") || 0),
    recordings: fields.get("recordings") !== null,
  };
}

/** @param {Refused} refused */
function show(refused) {
  const elsewhere = [];
  for (const { field, message } of refused.problem.errors ?? []) {
    const place = form.querySelector(`[data-field="${CSS.escape(field.split(".")[0])}"]`);
    if (place) place.textContent = message;
    else elsewhere.push(`${field}: ${message}`);
    form.elements.namedItem(field)?.setAttribute?.("aria-invalid", "true");
  }
  alert.textContent = [refused.message, ...elsewhere].join(" ");
  alert.hidden = false;
  alert.scrollIntoView({ block: "nearest" });
}

function forget() {
  alert.hidden = true;
  for (const place of form.querySelectorAll("[data-field]")) place.textContent = "";
  for (const field of form.querySelectorAll("[aria-invalid]")) field.removeAttribute("aria-invalid");
}
