"use strict";
(() => {
  const controls = document.querySelector(".controls");
  const choices = [...document.querySelectorAll(".choice")];

  // A part shows if it fits every control that it depends on. Curves exist for some measures: others show the first.
  const curves = new Set(choices.map((part) => part.dataset.curve).filter(Boolean));
  const show = () => {
    const chosen = Object.fromEntries(new FormData(controls));
    chosen.curve = curves.has(chosen.measure) ? chosen.measure : [...curves][0];
    for (const part of choices) {
      part.hidden = Object.entries(part.dataset).some(([name, value]) => name in chosen && chosen[name] !== value);
    }
  };
  controls.addEventListener("change", show);
  controls.addEventListener("submit", (event) => event.preventDefault());
  controls.hidden = false;
  show();

  // A click in a legend singles an algorithm out in all figures; another click brings the others back.
  const buttons = [...document.querySelectorAll(".legend button")];
  const marks = [...document.querySelectorAll("main svg [class*='a-']")];
  const single = (name) => {
    for (const button of buttons) {
      button.setAttribute("aria-pressed", String(button.value === name));
    }
    for (const mark of marks) {
      mark.classList.toggle("faded", name !== null && !mark.classList.contains(`a-${name}`));
    }
  };
  for (const button of buttons) {
    button.disabled = false;
    button.addEventListener("click", () => {
      single(button.getAttribute("aria-pressed") === "true" ? null : button.value);
    });
  }

  // A part that is wider than the screen is scrolled with the keyboard too.
  const wide = new ResizeObserver((parts) => {
    for (const { target } of parts) {
      if (target.scrollWidth > target.clientWidth) target.tabIndex = 0;
      else target.removeAttribute("tabindex");
    }
  });
  for (const part of document.querySelectorAll(".wide, pre")) wide.observe(part);

  // Paper shows what a closed part holds.
  let closed = [];
  addEventListener("beforeprint", () => {
    closed = [...document.querySelectorAll("details:not([open])")];
    for (const part of closed) part.open = true;
  });
  addEventListener("afterprint", () => {
    for (const part of closed) part.open = false;
  });
})();
