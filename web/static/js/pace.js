/** How fast something is sent, and how long the rest will take. */

const MEGABYTE = 1e6;
const WINDOW = 5000; // ms of which the rate is told
const SHORTEST = 0.5; // s before anything is told

/** The last seconds of something that grows. */
export class Pace {
  constructor() {
    /** @type {{at: number, done: number}[]} */
    this.lately = [];
  }

  /** Begins anew: it stood still. */
  forget() {
    this.lately = [];
  }

  /**
   * What to say, nothing yet at the beginning.
   * @param {number} done bytes
   * @param {number} size
   */
  said(done, size) {
    const at = performance.now();
    const fresh = this.lately.filter((one) => at - one.at < WINDOW && one.done <= done);
    this.lately = [...fresh, { at, done }];
    const seconds = (at - this.lately[0].at) / 1000;
    const rate = (done - this.lately[0].done) / seconds;
    if (seconds < SHORTEST || !rate) return "";
    const rest = (size - done) / rate;
    const left = rest < 90 ? `${Math.ceil(rest)} s` : `${Math.round(rest / 60)} min`;
    return `, ${(rate / MEGABYTE).toFixed(rate < MEGABYTE ? 2 : 1)} MB/s, ${left} left`;
  }
}
