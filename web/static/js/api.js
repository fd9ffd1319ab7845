/** Requests to the API, and what it says when it refuses. */

/**
 * @typedef {{field: string, message: string}} FieldError
 * @typedef {{title: string, status: number, detail?: string, errors?: FieldError[]}} Problem
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
 * The answer to a POST of JSON.
 * @param {string} path
 * @param {object} [body]
 * @returns {Promise<any>}
 * @throws {Refused}
 */
export async function post(path, body) {
  let response;
  try {
    response = await fetch(path, {
      method: "POST",
      headers: { "Content-Type": "application/json", Accept: "application/json", ...ownPage() },
      body: body === undefined ? undefined : JSON.stringify(body),
    });
  } catch {
    throw new Refused({ title: "The server cannot be reached.", status: 0 });
  }
  if (response.ok) return response.json();
  const kind = response.headers.get("Content-Type");
  throw new Refused(problemIn(kind, await response.text(), response.status));
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
  if (kind?.includes("json")) return JSON.parse(text);
  return { title: `The server answered ${status}.`, status };
}
