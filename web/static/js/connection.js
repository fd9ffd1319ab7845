/** The form that registers a policy server: tested first, and what it answered is shown. */
import { post, Refused } from "./api.js";
import { arrived } from "./policies.js";

/**
 * @typedef {{name: string, outcome: string, seconds: number, detail: string, hint: string}} Step
 * @typedef {{dialect: string, model: string, sessions: number, sees: string[], acts: string, stateless_transport: boolean}} About
 * @typedef {{fits: boolean, about: About | null, steps: Step[]}} Answer
 */

const form = /** @type {HTMLFormElement} */ (document.getElementById("connect"));
/** @type {(selector: string) => HTMLElement} */
const part = (selector) => /** @type {HTMLElement} */ (form.querySelector(selector));
const test = /** @type {HTMLButtonElement} */ (part("[data-try]"));
const register = /** @type {HTMLButtonElement} */ (part("[type=submit]"));
const why = part("[data-why]");
const alert = part("[role=alert]");
const answer = part("[data-answer]");
const WIRES = /** @type {Record<string, string>} */ ({ "http:": "act", "https:": "act", "tcp:": "gr00t" });
const WORDS = /** @type {Record<string, string>} */ ({
  address: "the address may be connected to",
  connection: "it answers, and says what it is",
  decision: "it decides, shown a made-up table",
});
const ABOUT = ["url", "wire", "concurrency", "timeout", "maps"]; // a change of these needs another test

test.addEventListener("click", () => tried());
form.addEventListener("submit", (event) => {
  event.preventDefault();
  registered();
});
form.addEventListener("input", (event) => {
  const { name, value } = /** @type {HTMLInputElement} */ (event.target);
  if (!ABOUT.includes(name)) return;
  ready(false);
  const wire = WIRES[value.split("//")[0]];
  if (name === "url" && wire) /** @type {HTMLSelectElement} */ (part("#wire")).value = wire;
});

/** Has the server try the address, and shows what came of it. */
async function tried() {
  const url = /** @type {HTMLInputElement} */ (part("#server-url"));
  if (!url.reportValidity()) return;
  answer.hidden = true;
  await working("Connecting…", async () => {
    /** @type {Answer} */
    const found = await post("/api/v1/policies/connection", { spec: spec() });
    show(found);
    ready(found.fits);
  });
}

async function registered() {
  await working("Registering…", async () => {
    const fields = new FormData(form);
    const about = { name: fields.get("name"), description: fields.get("description"), spec: spec() };
    const version = await post("/api/v1/policies", about);
    form.reset();
    answer.hidden = true;
    ready(false);
    await arrived(version, []);
  });
}

/** What is registered. @returns {Record<string, unknown>} @throws {Refused} the maps are no JSON */
function spec() {
  const fields = new FormData(form);
  const numbers = ["concurrency", "timeout"].filter((name) => fields.get(name));
  return {
    kind: "remote",
    url: String(fields.get("url")).trim(),
    wire: fields.get("wire"),
    ...Object.fromEntries(numbers.map((name) => [name, Number(fields.get(name))])),
    ...maps(String(fields.get("maps"))),
  };
}

/** @param {string} text */
function maps(text) {
  if (!text.trim()) return {};
  try {
    const { observation, action } = JSON.parse(text);
    return { observation, action };
  } catch (error) {
    const message = `is no JSON: ${/** @type {Error} */ (error).message}`;
    throw new Refused({ title: message, status: 0, errors: [{ field: "maps", message }] });
  }
}

/** @param {string} said @param {() => Promise<void>} work */
async function working(said, work) {
  tidy();
  test.disabled = register.disabled = true;
  why.textContent = said;
  try {
    await work();
  } catch (error) {
    ready(false);
    if (!(error instanceof Refused)) throw error;
    refused(error);
  } finally {
    test.disabled = false;
  }
}

/** @param {boolean} reached */
function ready(reached) {
  register.disabled = !reached;
  test.classList.toggle("primary", !reached);
  why.textContent = reached ? "" : "It is registered once the test has reached it.";
}

/** @param {Answer} found */
function show({ about, steps }) {
  const list = /** @type {HTMLElement} */ (answer.querySelector(".checks"));
  list.replaceChildren(...steps.map(item));
  const declared = /** @type {HTMLElement} */ (answer.querySelector(".declared"));
  declared.hidden = !about;
  if (about) declared.replaceChildren(...facts(about));
  answer.hidden = false;
}

/** @param {Step} step */
function item({ name, outcome, seconds, detail, hint }) {
  const made = document.createElement("li");
  made.className = outcome;
  const small = holding("small", detail);
  if (hint) small.append(holding("em", hint));
  const took = `${outcome} in ${seconds.toFixed(2)}\u202fs`;
  made.append(holding("b", WORDS[name] ?? name), " ", holding("span", took), " ", small);
  return made;
}

/** @param {About} about */
function facts({ dialect, model, sessions, sees, acts, stateless_transport }) {
  /** @type {Record<string, string>} */
  const told = {
    dialect: dialect + (stateless_transport ? ", told of no new episode but by a new connection" : ""),
    model: model || "it gives no name",
    "episodes at a time": String(sessions),
    sees: sees.length ? `${sees.length} entries: ${sees.join(", ")}` : "as the maps say",
    acts: acts || "as the maps say",
  };
  return Object.entries(told).map(([name, value]) => {
    const pair = document.createElement("div");
    if (name === "sees") pair.className = "long";
    pair.append(holding("dt", name), holding("dd", value));
    return pair;
  });
}

/** @param {Refused} problem */
function refused(problem) {
  const elsewhere = [];
  for (const { field, message } of problem.problem.errors ?? []) {
    const name = field.replace("spec.remote.", "spec.");
    const place = form.querySelector(`[data-field="${CSS.escape(name)}"]`);
    if (!place) elsewhere.push(`${field}: ${message}`);
    else place.textContent = message;
    if (place) form.querySelector(`[aria-describedby~="${place.id}"]`)?.setAttribute("aria-invalid", "true");
  }
  alert.textContent = [problem.message, ...elsewhere].join(" ");
  alert.hidden = false;
}

function tidy() {
  alert.hidden = true;
  for (const place of form.querySelectorAll("[data-field]")) place.textContent = "";
  for (const field of form.querySelectorAll("[aria-invalid]")) field.removeAttribute("aria-invalid");
}

/** @param {string} tag @param {string} text */
function holding(tag, text) {
  const made = document.createElement(tag);
  made.textContent = text;
  return made;
}
