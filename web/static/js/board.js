/** The leaderboard's forms: how many policies are ticked, and addresses without what is empty. */

/** @param {HTMLFormElement} form */
function tidied(form) {
  form.addEventListener("formdata", ({ formData }) => {
    for (const [name, value] of [...formData]) {
      if (value === "" || (name === "privileged" && value === "show")) formData.delete(name);
    }
  });
}

/** @param {HTMLFormElement} form  whose buttons say how many policies they want */
function counted(form) {
  const boxes = () => [...form.elements].filter((one) => one instanceof HTMLInputElement && one.type === "checkbox");
  const update = () => {
    const ticked = boxes().filter((box) => /** @type {HTMLInputElement} */ (box).checked).length;
    for (const button of form.querySelectorAll("button")) {
      const { least = form.dataset.least, most = form.dataset.most } = button.dataset;
      button.disabled = ticked < Number(least) || ticked > Number(most);
    }
    const count = form.querySelector(".count");
    if (count) count.textContent = ticked ? `${ticked} ticked` : `${form.dataset.least}–${form.dataset.most} ticked`;
  };
  document.addEventListener("change", update);
  window.addEventListener("pageshow", update);
  update();
}

document.querySelectorAll("form[data-tidy]").forEach((form) => tidied(/** @type {HTMLFormElement} */ (form)));
document.querySelectorAll("form.chosen").forEach((form) => counted(/** @type {HTMLFormElement} */ (form)));
