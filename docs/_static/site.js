// A click on a picture opens it alone, where the browser can enlarge it; on the drawing of a diagram, its page with zoom.
document.addEventListener("DOMContentLoaded", () => {
  for (const picture of document.querySelectorAll(".bd-article img")) {
    if (picture.closest("a")) continue;
    picture.style.cursor = "zoom-in";
    const page = picture.alt.startsWith("block diagram") ? picture.src.replace(/svg$/, "html") : picture.src;
    picture.onclick = () => { location.href = page; };
  }
});
