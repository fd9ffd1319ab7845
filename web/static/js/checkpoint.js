/** The form that uploads a checkpoint: the file is sent as it is, then chosen in the other form. */
import { ownPage, problemIn, Refused } from "./api.js";

const form = /** @type {HTMLFormElement} */ (document.getElementById("upload"));
const send = /** @type {HTMLButtonElement} */ (form.querySelector("[type=submit]"));
const stop = /** @type {HTMLButtonElement} */ (form.querySelector("[data-stop]"));
const alert = /** @type {HTMLElement} */ (form.querySelector("[role=alert]"));
const bar = /** @type {HTMLProgressElement} */ (form.querySelector("progress"));
const said = /** @type {HTMLElement} */ (form.querySelector("[role=status]"));
const MEGABYTE = 1e6;

/** @type {XMLHttpRequest | null} */
let underWay = null;

stop.addEventListener("click", () => underWay?.abort());
addEventListener("beforeunload", (event) => underWay && event.preventDefault());

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  forget();
  const fields = new FormData(form);
  const file = /** @type {File} */ (fields.get("file"));
  busy(true);
  try {
    check(file);
    const version = await upload(addressOf(fields), file);
    form.reset();
    const chosen = await choose(version.id);
    const where = chosen ? "and chosen below" : "load the page again to choose it";
    said.textContent = `${version.policy}@${version.version} is kept, ${where}.`;
    document.getElementById("policy")?.focus();
  } catch (error) {
    if (!(error instanceof Refused)) throw error;
    show(error);
  } finally {
    busy(false);
  }
});

/**
 * @param {FormData} fields
 * @returns {string}
 */
function addressOf(fields) {
  const query = new URLSearchParams();
  for (const name of ["name", "description"]) query.set(name, String(fields.get(name) ?? ""));
  return `/api/v1/policies/checkpoints?${query}`;
}

/**
 * @param {File} file
 * @throws {Refused}
 */
function check(file) {
  const most = Number(form.dataset.limit);
  if (!file.size) throw refused("body", "is empty");
  if (file.size > most) throw refused("body", `is too large: at most ${megabytes(most)} MB are taken`);
}

/**
 * @param {string} address
 * @param {File} file
 * @returns {Promise<any>}
 * @throws {Refused}
 */
function upload(address, file) {
  const request = new XMLHttpRequest(); // fetch does not tell how far it is
  underWay = request;
  request.open("POST", address);
  request.setRequestHeader("Content-Type", "application/octet-stream");
  for (const [name, value] of Object.entries(ownPage())) request.setRequestHeader(name, value);
  request.upload.addEventListener("progress", (event) => tell(event.loaded, file.size));
  request.upload.addEventListener("load", () => tellChecking());
  return new Promise((resolve, reject) => {
    request.addEventListener("load", () => {
      const { status, responseText } = request;
      if (status < 300) return resolve(JSON.parse(responseText));
      const kind = request.getResponseHeader("Content-Type");
      reject(new Refused(problemIn(kind, responseText, status)));
    });
    const ended = (why) => () => reject(refused("", why));
    request.addEventListener("error", ended("The connection to the server broke off."));
    request.addEventListener("abort", ended("Stopped; nothing was kept."));
    request.send(file);
  });
}

/**
 * The policies as the server shows them now, with this one chosen; the other form stays as it is.
 * @param {string} id
 * @returns {Promise<boolean>} whether the server answered
 */
async function choose(id) {
  const answer = await fetch(`/evaluations/new?policy=${encodeURIComponent(id)}`).catch(() => null);
  if (!answer?.ok) return false;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  for (const part of ["policy", "policies"]) {
    const fresh = page.getElementById(part);
    if (fresh) document.getElementById(part)?.replaceWith(fresh);
  }
  return true;
}

/**
 * @param {number} sent
 * @param {number} size
 */
function tell(sent, size) {
  bar.value = size ? sent / size : 0;
  said.textContent = `${megabytes(sent)} of ${megabytes(size)} MB sent`;
}

function tellChecking() {
  stop.hidden = true; // it is the server's now
  bar.removeAttribute("value");
  said.textContent = "Sent. The server loads it once to see that it can be played…";
}

/** @param {number} bytes */
function megabytes(bytes) {
  return (bytes / MEGABYTE).toFixed(bytes < 10 * MEGABYTE ? 1 : 0);
}

/** @param {boolean} now */
function busy(now) {
  if (!now) underWay = null;
  send.disabled = now;
  stop.hidden = bar.hidden = !now;
}

/**
 * @param {string} field
 * @param {string} message
 */
function refused(field, message) {
  return new Refused({ title: message, status: 0, errors: field ? [{ field, message }] : [] });
}

/** @param {Refused} refused */
function show(refused) {
  let placed = false;
  for (const { field, message } of refused.problem.errors ?? []) {
    const place = form.querySelector(`[data-field="${CSS.escape(field)}"]`);
    if (!place) continue;
    placed = true;
    place.textContent = message;
    form.querySelector(`[aria-describedby="${place.id}"]`)?.setAttribute("aria-invalid", "true");
  }
  said.textContent = "";
  alert.textContent = placed ? "The checkpoint was not taken." : refused.message;
  alert.hidden = false;
  alert.scrollIntoView({ block: "nearest" });
}

function forget() {
  alert.hidden = true;
  said.textContent = "";
  bar.value = 0;
  for (const place of form.querySelectorAll("[data-field]")) place.textContent = "";
  for (const field of form.querySelectorAll("[aria-invalid]")) field.removeAttribute("aria-invalid");
}
