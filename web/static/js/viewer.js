/** The Rerun viewer in a page: it opens a recording, seeks, and tells where it is. */

const SECOND = 1e9; // nanoseconds
const DECISION = "decision"; // the viewer's timeline of decisions, beside that of time
const PATIENCE = 50; // tries to seek in a recording that is still loading, 0.2 s each
const NARROW = 700; // pixels: no room for the viewer's own top bar

// The viewer writes 20,000 lines of debugging while it starts.
console.debug = () => {};

// It also asks the web for its latest release. This page asks nobody but its own server.
const ownFetch = window.fetch.bind(window);
window.fetch = async (input, options) => {
  const address = new URL(input instanceof Request ? input.url : input, location.href);
  if (address.origin === location.origin) return ownFetch(input, options);
  return new Response("{}", { status: 404, headers: { "Content-Type": "application/json" } });
};

/** @typedef {{time: number | bigint, timeline?: string, timeline_name?: string}} Shown */

export class Replay {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.place = place;
    this.live = place.dataset.live === "yes";
    this.timeline = "time";
    this.playing = false;
    /** @type {any} */
    this.viewer = null;
    /** @type {{seconds: number, decision: number} | null} */
    this.wanted = null;
    this.opened = false;
    this.settled = false; // it stands where it was asked to
  }

  /**
   * Start the viewer with the recording.
   * @param {{moved: (time: number, timeline: string) => void, played: (playing: boolean) => void}} told
   * @throws when the browser cannot run it
   */
  async start(told) {
    const { script = "", layout = "", recording = "" } = this.place.dataset;
    this.#keepFocus();
    const { WebViewer } = await import(script);
    this.viewer = new WebViewer();
    /** On its way to a moment that was asked for it passes others. @param {number} time */
    const moved = (time) => this.wanted || told.moved(time, this.timeline);
    this.viewer.on("time_update", (/** @type {Shown} */ { time }) => moved(Number(time)));
    this.viewer.on("timeline_change", (/** @type {Shown} */ { timeline, timeline_name, time }) => {
      this.timeline = timeline_name ?? timeline ?? this.timeline;
      moved(Number(time));
    });
    this.viewer.on("play", () => {
      if (!this.settled) return; // while it loads, it plays by itself
      this.wanted = null; // who plays in the viewer goes on from where it is
      told.played((this.playing = true));
    });
    this.viewer.on("pause", () => told.played((this.playing = false)));
    this.viewer.on("recording_open", () => this.#open());
    await this.viewer.start(null, this.place, {
      hide_welcome_screen: true,
      allow_fullscreen: false,
      width: "100%",
      height: "100%",
      theme: matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light",
    });
    if (this.place.clientWidth < NARROW) this.viewer.override_panel_state("top", "hidden");
    /** @type {any} */ (this.place).viewer = this.viewer;
    this.viewer.override_panel_state("blueprint", "hidden"); // it lists files while they load
    // Before the recording: else the viewer first lays it out as it sees fit.
    await this.viewer.open(absolute(layout));
    await this.viewer.open(absolute(recording));
  }

  /**
   * Show a moment, on the timeline that the viewer shows. The last of several quick calls counts.
   * @param {number} seconds @param {number} decision
   */
  async seek(seconds, decision) {
    const waiting = this.wanted !== null;
    this.wanted = { seconds, decision };
    if (waiting || !this.opened) return;
    for (let tries = 0; this.wanted !== null; tries++) {
      /** @type {{seconds: number, decision: number}} */
      const wanted = this.wanted;
      const taken = await this.#set({ ...this.#time(wanted), play_state: "paused" });
      const there = tries > PATIENCE || (taken && (await this.#isAt(wanted)));
      if (this.wanted !== wanted) tries = 0;
      else if (there) this.wanted = null;
      else await new Promise((resolve) => setTimeout(resolve, 200));
    }
  }

  /** Pass a moment, without making sure. @param {number} seconds @param {number} decision */
  glide(seconds, decision) {
    if (!this.opened) this.wanted = { seconds, decision };
    else if (!this.wanted) this.#set({ ...this.#time({ seconds, decision }), play_state: "paused" });
  }

  /** @param {{seconds: number, decision: number}} wanted */
  #time({ seconds, decision }) {
    if (this.timeline === DECISION) return { timeline: DECISION, sequence: decision };
    return { timeline: "time", duration_nanos: Math.round(seconds * SECOND) };
  }

  /** While it loads, the viewer goes no further than what it has. @param {{seconds: number, decision: number}} wanted */
  async #isAt(wanted) {
    const state = await this.viewer.get_state();
    const time = state?.recordings?.[0]?.current_time?.time;
    const { sequence, duration_nanos: nanoseconds = 0 } = this.#time(wanted);
    if (time === undefined) return false;
    return sequence === undefined ? Math.abs(Number(time) - nanoseconds) < 1e6 : Number(time) === sequence;
  }

  /** @param {boolean} playing @param {number} [from] seconds */
  async play(playing, from) {
    if (!this.opened) return;
    if (playing) this.wanted = null;
    else if (!this.playing) return;
    const start = from === undefined ? {} : { duration_nanos: Math.round(from * SECOND) };
    const timeline = playing ? "time" : this.timeline; // decisions would pass 30 a second
    await this.#set({ timeline, ...start, play_state: playing ? "playing" : "paused" });
  }

  async #open() {
    if (this.opened) return;
    this.opened = true;
    this.viewer.override_panel_state("blueprint", null);
    const wanted = this.wanted;
    this.wanted = null;
    if (this.live && wanted === null) await this.#set({ timeline: "time", play_state: "following" });
    else await this.seek(wanted?.seconds ?? 0, wanted?.decision ?? 0);
    this.settled = true;
  }

  /** The viewer takes the focus when it starts, and with it every key; only a reader may give it. */
  #keepFocus() {
    let given = false;
    this.place.addEventListener("pointerdown", () => (given = true), true);
    document.addEventListener("keydown", ({ key }) => (given ||= key === "Tab"), true);
    this.place.addEventListener("focusin", ({ target }) => given || /** @type {HTMLElement} */ (target).blur());
  }

  /** @param {object} time */
  async #set(time) {
    try {
      await this.viewer.set_time(time);
      return true;
    } catch (error) {
      console.warn("The viewer could not seek.", error); // the timeline is not there yet
      return false;
    }
  }
}

/** @param {string} path */
function absolute(path) {
  return new URL(path, location.href).href;
}
