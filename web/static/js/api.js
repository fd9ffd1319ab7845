/** Requests to the API, and what it says when it refuses. */

/**
 * @typedef {{field: string, message: string}} FieldError
 * @typedef {{name: string, outcome: string, seconds: number, detail: string}} Check
 * @typedef {{title: string, status: number, detail?: string, errors?: FieldError[], checks?: Check[]}} Problem
 */

/** A request that was refused; `problem` says why. */
export class Refused extends Error {
  /** @param {Problem} problem */
  constructor(problem) {
    super(problem.detail || problem.title);
    this.problem = problem;
  }
}

/**
 * The answer to a request.
 * @param {string} method
 * @param {string} path
 * @param {{headers?: Record<string, string>, body?: BodyInit}} [sent]
 * @returns {Promise<Response>}
 * @throws {Refused}
 */
export async function ask(method, path, { headers = {}, body } = {}) {
  let response;
  try {
    const known = { Accept: "application/json", ...ownPage(), ...headers };
    response = await fetch(path, { method, headers: known, body });
  } catch {
    throw unreachable();
  }
  if (response.ok) return response;
  const kind = response.headers.get("Content-Type");
  throw new Refused(problemIn(kind, await response.text(), response.status));
}

/** What is said when no answer comes; its status is 0. */
export function unreachable() {
  return new Refused({ title: "The server cannot be reached.", status: 0 });
}

/**
 * The answer to a POST of JSON.
 * @param {string} path
 * @param {object} [body]
 * @returns {Promise<any>}
 * @throws {Refused}
 */
export async function post(path, body) {
  const headers = { "Content-Type": "application/json" };
  const sent = body === undefined ? undefined : JSON.stringify(body);
  return (await ask("POST", path, { headers, body: sent })).json();
}

/**
 * What shows the server that a page of its own asks; empty where nobody signs in.
 * @returns {Record<string, string>}
 */
export function ownPage() {
  const meta = /** @type {HTMLMetaElement | null} */ (document.querySelector('meta[name="csrf"]'));
  return meta ? { "X-CSRF-Token": meta.content } : {};
}

/**
 * What an answer that is no success says.
 * @param {string | null} kind its Content-Type
 * @param {string} text
 * @param {number} status
 * @returns {Problem}
 */
export function problemIn(kind, text, status) {
  if (kind?.includes("json") && text) return JSON.parse(text); // an answer to HEAD has no text
  return { title: `The server answered ${status}.`, status };
}
