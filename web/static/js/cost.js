/** What an evaluation would cost, in words. */

/**
 * @typedef {{used: number, limit: number | null}} Quota
 * @typedef {{policy: string, version: number, tasks: string[], episodes: number, shards: number,
 *   ranked: boolean, workers: number, per_minute: number | null, seconds: number | null,
 *   basis_detail: string, evaluations_before: number, shards_before: number,
 *   seconds_before: number | null, quotas: {attempts: Quota, scored: Quota},
 *   refused: string | null}} Estimate
 */

const list = /** @type {HTMLElement} */ (document.getElementById("cost"));

/**
 * Shows an estimate, also on the button that starts.
 * @param {Estimate | null} found null: what is asked for is wrong
 * @param {HTMLButtonElement} button
 */
export function showCost(found, button) {
  list.setAttribute("aria-busy", String(!found));
  const { first: missing, whose } = chosen().dataset;
  button.disabled = Boolean(missing || found?.refused);
  if (missing || !found) {
    button.textContent = missing ?? "Start";
  }
  if (!found) return;
  const what = `${counted(found.tasks.length, "task")}, handed out as ${counted(found.shards, "shard")}`;
  tell("episodes", String(found.episodes), `of ${whose ?? `${found.policy}@${found.version}`}; ${what}`);
  if (whose && found.seconds !== null) tell("time", "not known yet", `estimated once ${whose} is on this server`);
  else tell("time", found.seconds === null ? "never" : about(found.seconds), pace(found));
  tell("before", before(found), waiting(found, Boolean(whose)));
  tell("ranked", found.ranked ? "enters it" : "stays out of it", found.ranked ? "once every episode is final" : "only the whole suite and split, by the rules hide, is ranked");
  const { attempts, scored } = found.quotas;
  /** @type {HTMLElement} */ (list.querySelector("[data-quota]")).hidden = attempts.limit === null && scored.limit === null;
  tell("quota", left(attempts), found.refused ?? `evaluations in 24 hours; scored in 30 days: ${left(scored)}`);
  if (!missing) button.textContent = sentence(found);
}

/**
 * Shows that there is nothing to estimate, and why.
 * @param {string} why
 * @param {HTMLButtonElement} button
 */
export function showNothing(why, button) {
  list.setAttribute("aria-busy", "false");
  button.disabled = true;
  button.textContent = why;
  tell("episodes", "none", why);
  for (const name of ["time", "before", "ranked", "quota"]) tell(name, "–", "");
}

/** Where the policy comes from. */
function chosen() {
  return /** @type {HTMLInputElement} */ (document.querySelector('[name="source"]:checked'));
}

/** @param {string} name @param {string} main @param {string} more */
function tell(name, main, more) {
  const place = /** @type {HTMLElement} */ (list.querySelector(`[data-cost="${name}"]`));
  const bold = document.createElement("b");
  const small = document.createElement("small");
  bold.textContent = main;
  small.textContent = more;
  place.replaceChildren(bold, small);
}

/** @param {Estimate} found */
function pace({ workers, per_minute, basis_detail }) {
  if (per_minute === null) return "this server has no workers; nothing is played";
  return `${per_minute.toFixed(per_minute < 10 ? 1 : 0)} a minute by ${counted(workers, "worker")}, ${basis_detail}`;
}

/** @param {Estimate} found */
function before({ evaluations_before }) {
  return evaluations_before ? counted(evaluations_before, "evaluation") : "nothing";
}

/** @param {Estimate} found @param {boolean} unknown whether its own pace is */
function waiting({ evaluations_before, shards_before, seconds_before }, unknown) {
  if (!evaluations_before) {
    if (!seconds_before) return "it begins at once";
    return unknown ? "what is played now goes on" : `what is played now ends in ${about(seconds_before)}`;
  }
  const later = unknown || seconds_before === null ? "" : `, ${about(seconds_before)} more`;
  return `${counted(shards_before, "shard")}${later}; those of its priority take turns with it`;
}

/** @param {Estimate} found */
function sentence({ episodes, seconds, evaluations_before }) {
  const parts = [`Start ${counted(episodes, "episode")}`];
  if (seconds !== null) parts.push(about(seconds));
  if (evaluations_before) parts.push(`${counted(evaluations_before, "evaluation")} before it`);
  return parts.join(", ");
}

/** @param {Quota} quota */
function left({ used, limit }) {
  return limit === null ? "no limit" : `${Math.max(0, limit - used)} of ${limit}`;
}

/** @param {number} number @param {string} what */
function counted(number, what) {
  return `${number} ${what}${number === 1 ? "" : "s"}`;
}

/** @param {number} seconds */
function about(seconds) {
  if (seconds < 90) return `about ${Math.max(1, Math.round(seconds))} s`;
  const minutes = Math.round(seconds / 60);
  if (minutes < 90) return `about ${minutes} min`;
  return `about ${(minutes / 60).toFixed(1)} h`;
}
