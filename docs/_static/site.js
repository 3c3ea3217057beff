// A click on a picture opens it alone, where the browser can enlarge it.
document.addEventListener("DOMContentLoaded", () => {
  for (const picture of document.querySelectorAll(".bd-article img")) {
    if (picture.closest("a")) continue;
    picture.style.cursor = "zoom-in";
    picture.onclick = () => { location.href = picture.src; };
  }
});
