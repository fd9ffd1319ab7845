/** The form that uploads a checkpoint: hashed, sent piece by piece, tried, chosen in the other form. */
import { Refused } from "./api.js";
import { sameHash, showChecks } from "./checks.js";
import { dropping, keepName } from "./drop.js";
import { digestOf } from "./hash.js";
import { Pace } from "./pace.js";
import { arrived, from, refresh } from "./policies.js";
import { finish, forget, Paused, Sending } from "./tus.js";

const form = /** @type {HTMLFormElement} */ (document.getElementById("upload"));
/** @type {(selector: string) => HTMLElement} */
const part = (selector) => /** @type {HTMLElement} */ (form.querySelector(selector));
const send = /** @type {HTMLButtonElement} */ (part("[type=submit]"));
const pause = part("[data-pause]");
const goOn = part("[data-go-on]");
const alert = part("[role=alert]");
const bar = /** @type {HTMLProgressElement} */ (part("progress"));
const said = part("[role=status]");
const hashed = part("[data-hash]");
const shown = part("[data-pace]");
const pace = new Pace();
const steps = part(".checks");
const MEGABYTE = 1e6;
const SAY_EVERY = 10000; // ms: whoever listens to the page is told no more often

/**
 * An upload of the form's, or one that is to be gone on with.
 * @type {{sending: Sending | null, running: boolean, stopped: boolean}}
 */
const now = { sending: null, running: false, stopped: false };
/** @type {{name: string, sha256: string} | null} */
let expected = null;
let saidAt = 0;
let telling = "";

dropping(form, () => now.running);
addEventListener("beforeunload", (event) => now.running && event.preventDefault());
addEventListener("online", () => now.sending?.hurry());
pause.addEventListener("click", () => {
  now.stopped = true;
  now.sending?.pause();
});
goOn.addEventListener("click", () => run());
form.addEventListener("submit", (event) => {
  event.preventDefault();
  now.sending = null;
  run();
});
form.addEventListener("change", () => {
  if (now.running) return;
  now.sending = null;
  offer(false);
});
document.addEventListener("click", (event) => {
  const button = /** @type {HTMLElement} */ (event.target).closest?.("[data-unfinished]");
  const row = /** @type {HTMLElement | null} */ (button?.closest("[data-upload]") ?? null);
  if (row) unfinished(row, /** @type {HTMLElement} */ (button).dataset.unfinished);
});

/** Begins with what the form says, or goes on. */
async function run() {
  tidy();
  busy(true);
  try {
    pause.focus();
    const sending = (now.sending ??= await prepared(new FormData(form)));
    await sending.send();
    await kept(await checked(() => sending.version()), sending.about.sha256);
    now.sending = null;
  } catch (error) {
    failed(error);
  } finally {
    busy(false);
  }
}

/**
 * The file of the form, hashed.
 * @param {FormData} fields
 * @throws {Refused}
 */
async function prepared(fields) {
  const file = /** @type {File} */ (fields.get("file"));
  const most = Number(form.dataset.limit);
  if (!file.size) throw refused("is empty");
  if (file.size > most) throw refused(`is too large: at most ${megabytes(most)} MB are taken`);
  const sha256 = await digestOf(file, (done) => {
    if (now.stopped) throw new Paused();
    tell("Hashing: ", done, file.size);
  });
  hashed.textContent = `SHA-256 ${sha256}`;
  const name = String(fields.get("name"));
  if (expected && expected.name === name && expected.sha256 !== sha256) {
    const was = `${expected.sha256.slice(0, 12)}…`;
    throw refused(`is another file than the one that was begun, whose SHA-256 is ${was}; choose that one, or forget it below`);
  }
  const about = { name, description: String(fields.get("description")), sha256 };
  return new Sending(file, about, {
    progress: (sent) => tell("Sending: ", sent, file.size),
    trouble: (why, seconds) => interrupted(`${why} Trying again in ${seconds} s; what came is kept.`),
  });
}

/**
 * What the server makes of a file that came whole.
 * @param {() => Promise<any>} version
 */
function checked(version) {
  pause.hidden = true; // it is the server's now
  bar.removeAttribute("value");
  shown.textContent = "";
  say("Sent. The server hashes it, loads it once and asks it for a decision…");
  return version();
}

/**
 * Shows what became of it, and chooses it.
 * @param {any} version
 * @param {string} sha256
 */
async function kept(version, sha256) {
  expected = null;
  form.reset();
  say("");
  await arrived(version, [...sameHash(sha256), ...version.checks]);
}

/** @param {unknown} error */
async function failed(error) {
  if (error instanceof Paused) {
    offer(Boolean(now.sending));
    say(now.sending ? "Paused; what came is kept." : "Stopped; nothing was sent.");
    (now.sending ? goOn : send).focus();
  } else if (error instanceof Refused) {
    show(error);
    const whole = now.sending?.path;
    now.sending = null;
    if (whole) await refresh();
  } else throw error;
}

/**
 * What a row of the uploads that are not done is asked to do.
 * @param {HTMLElement} row
 * @param {string | undefined} what
 */
async function unfinished(row, what) {
  if (now.running) return;
  const { upload = "", name = "", sha256 = "" } = row.dataset;
  tidy();
  if (what === "choose") {
    expected = { name, sha256 };
    /** @type {HTMLInputElement} */ (form.elements.namedItem("name")).value = name;
    keepName(form);
    from("upload");
    say(`Choose the file of ${name} again, the one whose SHA-256 begins with ${sha256.slice(0, 12)}.`);
    return part("[name=file]").focus();
  }
  busy(true);
  try {
    if (what === "forget") await forget(upload).then(() => refresh());
    else await kept(await checked(() => finish(`/api/v1/uploads/${upload}`, name, sha256)), sha256);
  } catch (error) {
    failed(error);
  } finally {
    busy(false);
  }
}

// --- what is said ---

/**
 * @param {string} what
 * @param {number} done
 * @param {number} size
 */
function tell(what, done, size) {
  if (what !== telling) pace.forget();
  bar.value = size ? done / size : 0;
  const text = `${what}${megabytes(done)} of ${megabytes(size)} MB`;
  shown.textContent = text + pace.said(done, size);
  if (what !== telling || Date.now() - saidAt > SAY_EVERY) say(text);
  telling = what;
}

/** The line is cut, or the server is busy: nothing moves. @param {string} text */
function interrupted(text) {
  pace.forget();
  shown.textContent = "";
  say(text);
}

/** @param {string} text */
function say(text) {
  said.textContent = text;
  saidAt = Date.now();
}

/** @param {number} bytes */
function megabytes(bytes) {
  return (bytes / MEGABYTE).toFixed(bytes < 10 * MEGABYTE ? 1 : 0);
}

/** @param {boolean} running */
function busy(running) {
  Object.assign(now, { running, stopped: false });
  send.disabled = running;
  pause.hidden = bar.hidden = !running;
  pace.forget();
  telling = "";
  if (!running) shown.textContent = "";
  if (running) offer(false);
}

/** Offers to go on, in place of a beginning. @param {boolean} paused */
function offer(paused) {
  goOn.hidden = !paused;
  send.hidden = paused;
}

/** What is wrong with the file. @param {string} message */
function refused(message) {
  return new Refused({ title: message, status: 0, errors: [{ field: "body", message }] });
}

/** @param {Refused} refused */
function show(refused) {
  const { errors = [], checks = [] } = refused.problem;
  let placed = false;
  for (const { field, message } of errors) {
    const place = form.querySelector(`[data-field="${CSS.escape(field)}"]`);
    if (!place) continue;
    placed = true;
    place.textContent = message;
    form.querySelector(`[aria-describedby="${place.id}"]`)?.setAttribute("aria-invalid", "true");
  }
  said.textContent = "";
  const came = checks.length && now.sending ? sameHash(now.sending.about.sha256) : [];
  showChecks(steps, [...came, ...checks]);
  alert.textContent = placed ? "The checkpoint was not taken." : refused.message;
  alert.hidden = false;
  alert.scrollIntoView({ block: "nearest" });
}

function tidy() {
  alert.hidden = true;
  said.textContent = "";
  if (!now.sending) hashed.textContent = "";
  bar.value = 0;
  showChecks(steps, []);
  for (const place of form.querySelectorAll("[data-field]")) place.textContent = "";
  for (const field of form.querySelectorAll("[aria-invalid]")) field.removeAttribute("aria-invalid");
}
