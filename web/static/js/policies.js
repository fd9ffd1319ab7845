/** The policies that can be chosen, as the server lists them now. */
import { showChecks } from "./checks.js";

/** @typedef {import("./api.js").Check} Check */

const kept = /** @type {HTMLElement} */ (document.getElementById("kept"));

/**
 * Lists as the server shows them now, with this policy chosen; the forms stay as they are.
 * @param {string} [id]
 * @returns {Promise<boolean>} whether the server answered
 */
export async function refresh(id) {
  const query = id ? `?policy=${encodeURIComponent(id)}` : "";
  const answer = await fetch(`/evaluations/new${query}`).catch(() => null);
  if (!answer?.ok) return false;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html");
  for (const one of ["unfinished", ...(id ? ["policy", "policies"] : [])]) {
    const fresh = page.getElementById(one);
    if (fresh) document.getElementById(one)?.replaceWith(fresh);
  }
  return true;
}

/**
 * Chooses a version that has just come, and says so.
 * @param {{id: string, policy: string, version: number}} version
 * @param {Check[]} checks what was tried of it
 */
export async function arrived(version, checks) {
  const chosen = await refresh(version.id);
  const said = /** @type {HTMLElement} */ (kept.querySelector("[role=status]"));
  const where = chosen ? "and chosen below" : "load the page again to choose it";
  kept.hidden = false;
  showChecks(/** @type {HTMLElement} */ (kept.querySelector(".checks")), checks);
  said.textContent = `${version.policy}@${version.version} is kept, ${where}. `;
  const link = document.createElement("a");
  link.href = `/policies/${version.id}`;
  link.textContent = "Its page";
  said.append(link);
  from("here");
  const select = document.getElementById("policy");
  select?.dispatchEvent(new Event("change", { bubbles: true }));
  select?.focus();
}

/** Shows where a policy comes from. @param {"here" | "upload" | "server"} source */
export function from(source) {
  const radio = document.querySelector(`[name="source"][value="${source}"]`);
  /** @type {HTMLInputElement} */ (radio).checked = true;
  radio?.dispatchEvent(new Event("change", { bubbles: true }));
}
