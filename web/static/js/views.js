/** Saved views: names for addresses, kept in this browser; and the address of this one, copied. */

const KEPT = "hide-seek.views";

/** @typedef {{name: string, address: string}} View */

/** @returns {View[]} */
function views() {
  try {
    const found = JSON.parse(localStorage.getItem(KEPT) ?? "[]");
    return Array.isArray(found) ? found.filter((one) => typeof one?.name === "string" && isOurs(one.address)) : [];
  } catch {
    return []; // nothing is kept here, or not by us
  }
}

/** An address of this site alone. @param {unknown} address */
function isOurs(address) {
  return typeof address === "string" && /^\/(?!\/)/.test(address);
}

/** @param {View[]} found @returns {boolean} */
function keep(found) {
  try {
    localStorage.setItem(KEPT, JSON.stringify(found));
    return true;
  } catch {
    return false;
  }
}

/** Bring the menu of views and the copying of links to life. */
export function start() {
  const form = /** @type {HTMLFormElement} */ (document.getElementById("save-view"));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const name = String(new FormData(form).get("name")).trim();
    const others = views().filter((one) => one.name !== name);
    const kept = keep([...others, { name, address: here() }]);
    tell(kept ? `Saved “${name}”.` : "This browser keeps nothing for this site; copy the link instead.");
    form.reset();
    show();
  });
  show();
  document.getElementById("copy-link")?.addEventListener("click", copy);
}

/** The address of what is shown, without the place in the list. */
function here() {
  const asked = new URLSearchParams(location.search);
  asked.delete("cursor");
  return location.pathname + (asked.size ? `?${asked}` : "");
}

/** @param {string} text */
function tell(text) {
  /** @type {HTMLElement} */ (document.querySelector("#views [role=status]")).textContent = text;
}

function show() {
  const list = /** @type {HTMLElement} */ (document.getElementById("saved-views"));
  list.replaceChildren(...views().map(row));
}

/** @param {View} view */
function row(view) {
  const li = document.createElement("li");
  const link = Object.assign(document.createElement("a"), { href: view.address, textContent: view.name });
  if (view.address === here()) link.setAttribute("aria-current", "true");
  const drop = Object.assign(document.createElement("button"), { type: "button", textContent: "×" });
  drop.setAttribute("aria-label", `Forget the view ${view.name}`);
  drop.addEventListener("click", () => {
    keep(views().filter((one) => one.name !== view.name));
    tell(`Forgot “${view.name}”.`);
    show();
  });
  li.append(link, drop);
  return li;
}

async function copy() {
  const said = /** @type {HTMLElement} */ (document.getElementById("copied"));
  try {
    await navigator.clipboard.writeText(location.origin + here());
    said.textContent = "Copied";
  } catch {
    said.textContent = "Copy it from the address bar"; // without https a browser lets no page copy
  }
  setTimeout(() => (said.textContent = ""), 4000);
}
