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
      headers: { "Content-Type": "application/json", Accept: "application/json" },
      body: body === undefined ? undefined : JSON.stringify(body),
    });
  } catch {
    throw new Refused({ title: "The server cannot be reached.", status: 0 });
  }
  if (response.ok) return response.json();
  throw new Refused(await problemOf(response));
}

/**
 * @param {Response} response
 * @returns {Promise<Problem>}
 */
async function problemOf(response) {
  const kind = response.headers.get("Content-Type") ?? "";
  if (kind.includes("json")) return response.json();
  return { title: `The server answered ${response.status}.`, status: response.status };
}
