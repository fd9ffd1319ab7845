/** Keeps the demo's page up to date until both policies have played. */

const EVERY = 2500; // ms

setTimeout(look, EVERY);

async function look() {
  const answer = document.hidden ? null : await fetch(location.pathname).catch(() => null);
  if (answer?.ok) {
    const page = new DOMParser().parseFromString(await answer.text(), "text/html");
    const fresh = page.getElementById("demo");
    const here = document.getElementById("demo");
    if (fresh && here && !here.contains(document.activeElement)) here.replaceWith(fresh);
    if (fresh?.dataset.done === "yes") return;
  }
  setTimeout(look, EVERY);
}
