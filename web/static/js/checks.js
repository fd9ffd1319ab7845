/** What was tried of a policy, one line a step, as the macro `checks` of parts.html writes it. */

/** @typedef {import("./api.js").Check} Check */

/**
 * What the server's answer shows: the bytes there are those here. Nothing, if none were hashed here.
 * @param {string} sha256
 * @returns {Check[]}
 */
export function sameHash(sha256) {
  return sha256 ? [{ name: "hash", outcome: "passed", seconds: 0, detail: sha256 }] : [];
}

/**
 * Replaces what is shown; without checks the list is hidden.
 * @param {HTMLElement} list its `data-words` says what the names mean
 * @param {Check[]} checks
 */
export function showChecks(list, checks) {
  const words = JSON.parse(list.dataset.words ?? "{}");
  list.replaceChildren(...checks.map((one) => item(one, words[one.name] ?? one.name)));
  list.hidden = !checks.length;
}

/** @param {Check} check @param {string} words */
function item({ outcome, seconds, detail }, words) {
  const made = document.createElement("li");
  made.className = outcome;
  const took = seconds ? `${outcome} in ${seconds.toFixed(2)}\u202fs` : outcome;
  made.append(holding("b", words), " ", holding("span", took), " ", holding("small", detail));
  return made;
}

/** @param {string} tag @param {string} text */
function holding(tag, text) {
  const made = document.createElement(tag);
  made.textContent = text;
  return made;
}
