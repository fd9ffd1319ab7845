/**
 * Sends a file by tus 1.0 (https://tus.io), as server/client_uploads.py does: where it was cut off it
 * goes on, after a reload and from another machine as well, for the server is asked what it has.
 */
import { ask, ownPage, problemIn, Refused, unreachable } from "./api.js";
import { readable } from "./hash.js";

const UPLOADS = "/api/v1/uploads";
const PIECE = 8 * 2 ** 20; // bytes of one request
const TUS = { "Tus-Resumable": "1.0.0" };
const BYTES = { ...TUS, "Content-Type": "application/offset+octet-stream" };
// no answer, too slow, another offset, the broken connection is not noticed yet, a proxy's
const PASSING = [0, 408, 409, 423, 502, 503, 504];
const WAITS = [0.5, 1, 2, 4, 8, 15, 30]; // s before the next try, while nothing comes through

/** Whoever uploads has stopped it; what came is kept. */
export class Paused extends Error {}

/**
 * @typedef {{id: string, name: string, sha256: string | null, offset: number, length: number}} Begun
 * @typedef {{progress: (sent: number) => void, trouble: (said: string, seconds: number) => void}} Told
 */

/** One file on its way. */
export class Sending {
  /**
   * @param {File} file
   * @param {{name: string, description: string, sha256: string}} about
   * @param {Told} told
   */
  constructor(file, about, told) {
    this.file = file;
    this.about = about;
    this.told = told;
    this.path = "";
    this.paused = false;
    /** @type {XMLHttpRequest | null} */
    this.underWay = null;
    /** @type {(() => void) | null} */
    this.wake = null;
  }

  /** Stops it; `version` goes on. */
  pause() {
    this.paused = true;
    this.underWay?.abort();
    this.wake?.();
  }

  /** Tries again at once, if it waits to. */
  hurry() {
    this.wake?.();
  }

  /**
   * Sends what is not there yet.
   * @throws {Refused}
   * @throws {Paused}
   */
  async send() {
    this.paused = false;
    this.path ||= /** @type {string} */ (await this.persist(() => this.begin()));
    let offset = await this.persist(() => this.offset());
    while (offset < this.file.size) offset = await this.persist(() => this.add(offset), offset);
  }

  /** The upload of this very file that is begun, or a new one. @returns {Promise<string>} */
  async begin() {
    const { name, sha256 } = this.about;
    const there = (await unfinished()).find(
      (one) => one.name === name && one.sha256 === sha256 && one.length === this.file.size,
    );
    if (there) return `${UPLOADS}/${there.id}`;
    const pairs = Object.entries(this.about).map(([key, value]) => `${key} ${inBase64(value)}`);
    const headers = {
      ...TUS,
      "Upload-Length": String(this.file.size),
      "Upload-Metadata": pairs.join(","),
    };
    return (await ask("POST", UPLOADS, { headers })).headers.get("Location") ?? "";
  }

  /** @returns {Promise<number>} */
  async offset() {
    const offset = offsetIn(await ask("HEAD", this.path, { headers: TUS }));
    this.told.progress(offset);
    return offset;
  }

  /**
   * Sends one piece; the offset behind it. fetch would not tell how far it is.
   * @param {number} offset
   * @returns {Promise<number>}
   */
  add(offset) {
    const request = new XMLHttpRequest();
    this.underWay = request;
    request.open("PATCH", this.path);
    const headers = { ...BYTES, ...ownPage(), "Upload-Offset": String(offset) };
    for (const [name, value] of Object.entries(headers)) request.setRequestHeader(name, value);
    request.upload.addEventListener("progress", (event) => this.told.progress(offset + event.loaded));
    return new Promise((resolve, reject) => {
      request.addEventListener("load", () => {
        const { status, responseText } = request;
        if (status < 300) return resolve(Number(request.getResponseHeader("Upload-Offset")));
        const kind = request.getResponseHeader("Content-Type");
        reject(new Refused(problemIn(kind, responseText, status)));
      });
      request.addEventListener("error", () => reject(unreachable()));
      request.addEventListener("abort", () => reject(new Paused()));
      request.send(this.file.slice(offset, offset + PIECE));
    });
  }

  /**
   * Does it until it comes through; of what broke off, the server is asked how much it has.
   * @template T
   * @param {() => Promise<T>} work
   * @param {number} [before] the offset, if the work adds to the file
   * @returns {Promise<T | number>}
   */
  async persist(work, before) {
    for (let tries = 0; ; tries += 1) {
      try {
        if (this.paused) throw new Paused();
        if (before === undefined || tries === 0) return await work();
        const offset = await this.offset();
        return offset === before ? await work() : offset;
      } catch (error) {
        if (!(error instanceof Refused) || !PASSING.includes(error.problem.status)) throw error;
        await readable(this.file); // to the browser, one that has changed looks like a cut line
        const seconds = WAITS[Math.min(tries, WAITS.length - 1)];
        this.told.trouble(error.message, seconds);
        await this.wait(seconds);
      }
    }
  }

  /** @param {number} seconds */
  wait(seconds) {
    return new Promise((resolve) => {
      const done = () => resolve((this.wake = null));
      const timer = setTimeout(done, 1000 * seconds);
      this.wake = () => (clearTimeout(timer), done());
    });
  }

  /** The version that the file becomes; the server tries it first. @throws {Refused} */
  async version() {
    return this.persist(() => finish(this.path, this.about.name, this.about.sha256));
  }
}

/** One's own uploads that are not done. @returns {Promise<Begun[]>} */
export async function unfinished() {
  return (await ask("GET", UPLOADS)).json();
}

/**
 * Has the server make what came whole a policy's version.
 * @param {string} path
 * @param {string} name of the policy
 * @param {string} sha256
 */
export async function finish(path, name, sha256) {
  try {
    return await (await ask("POST", `${path}/version`)).json();
  } catch (error) {
    // Perhaps it was made, and only the answer was lost.
    const gone = error instanceof Refused && error.problem.status === 404;
    const there = gone && (await versionOf(name, sha256));
    if (there) return there;
    throw error;
  }
}

/** The policy's newest version, if it plays this file. @param {string} name @param {string} sha256 */
async function versionOf(name, sha256) {
  if (!sha256) return null;
  const answer = await ask("GET", `/api/v1/policies/${encodeURIComponent(name)}`).catch(() => null);
  const newest = answer && (await answer.json());
  const converted = newest?.checks.some((/** @type {{detail: string}} */ one) => one.detail.includes(sha256));
  return newest?.spec.sha256 === sha256 || converted ? newest : null;
}

/** Forgets an upload. @param {string} id */
export async function forget(id) {
  await ask("DELETE", `${UPLOADS}/${id}`, { headers: TUS });
}

/** @param {Response} answer */
function offsetIn(answer) {
  return Number(answer.headers.get("Upload-Offset"));
}

/** @param {string} text */
function inBase64(text) {
  return btoa(String.fromCharCode(...new TextEncoder().encode(text)));
}
