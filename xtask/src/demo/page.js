for (const card of document.querySelectorAll("article")) {
  const figure = card.querySelector("figure");
  const slider = figure.querySelector("input");
  const left = figure.querySelector(".left");
  const buttons = card.querySelectorAll("button");
  const place = () => figure.style.setProperty("--at", `${slider.value}%`);
  slider.addEventListener("input", place);
  place(); // A reloaded page may keep its sliders where they were.
  for (const button of buttons) {
    button.addEventListener("click", () => {
      left.src = button.dataset.file;
      left.alt = figure.querySelector(".label").textContent = button.dataset.title;
      for (const other of buttons) other.setAttribute("aria-pressed", other === button);
    });
  }
}
