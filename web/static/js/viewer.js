/** The Rerun viewer in a page: it opens a recording, seeks, and tells where it is. */

const SECOND = 1e9; // nanoseconds
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

export class Replay {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.place = place;
    this.live = place.dataset.live === "yes";
    this.timeline = "time";
    this.playing = false;
    /** @type {any} */
    this.viewer = null;
    /** @type {number | null} */
    this.wanted = null;
    this.opened = false;
  }

  /**
   * Start the viewer with the recording.
   * @param {{opened: () => void, moved: (time: number, timeline: string) => void, played: (playing: boolean) => void}} told
   * @throws when the browser cannot run it
   */
  async start(told) {
    const { script = "", layout = "", recording = "" } = this.place.dataset;
    const { WebViewer } = await import(script);
    this.viewer = new WebViewer();
    this.viewer.on("time_update", ({ time }) => told.moved(time, this.timeline));
    this.viewer.on("timeline_change", ({ timeline, timeline_name, time }) => {
      this.timeline = timeline_name ?? timeline;
      told.moved(time, this.timeline);
    });
    this.viewer.on("play", () => told.played((this.playing = true)));
    this.viewer.on("pause", () => told.played((this.playing = false)));
    this.viewer.on("recording_open", () => {
      told.opened();
      this.#open();
    });
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

  /** Show a moment. The last of several quick calls counts. @param {number} seconds */
  async seek(seconds) {
    const waiting = this.wanted !== null;
    this.wanted = seconds;
    if (waiting || !this.opened) return;
    for (let tries = 0; this.wanted !== null; tries++) {
      const nanoseconds = Math.round(this.wanted * SECOND);
      await this.#set({ timeline: "time", duration_nanos: nanoseconds, play_state: "paused" });
      const there = tries > PATIENCE || (await this.#isAt(nanoseconds));
      if (this.wanted !== null && Math.round(this.wanted * SECOND) !== nanoseconds) tries = 0;
      else if (there) this.wanted = null;
      else await new Promise((resolve) => setTimeout(resolve, 200));
    }
  }

  /** While it loads, the viewer goes no further than what it has. @param {number} nanoseconds */
  async #isAt(nanoseconds) {
    const state = await this.viewer.get_state();
    const time = state?.recordings?.[0]?.current_time?.time;
    return time !== undefined && Math.abs(Number(time) - nanoseconds) < 1e6;
  }

  /** @param {boolean} playing */
  async play(playing) {
    this.wanted = null;
    if (this.opened) await this.#set({ timeline: "time", play_state: playing ? "playing" : "paused" });
  }

  async #open() {
    if (this.opened) return;
    this.opened = true;
    this.viewer.override_panel_state("blueprint", null);
    const wanted = this.wanted;
    this.wanted = null;
    if (this.live && wanted === null) await this.#set({ timeline: "time", play_state: "following" });
    else await this.seek(wanted ?? 0);
  }

  /** @param {object} time */
  async #set(time) {
    try {
      await this.viewer.set_time(time);
    } catch (error) {
      console.warn("The viewer could not seek.", error); // the timeline is not there yet
    }
  }
}

/** @param {string} path */
function absolute(path) {
  return new URL(path, location.href).href;
}
