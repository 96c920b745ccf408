// One cursor over all charts: the values at the time under the pointer.
const { span, time, charts } = JSON.parse(document.getElementById("curves").textContent);
const plots = [...document.querySelectorAll(".plot")];

function nearest(seconds) {
  let low = 0, high = time.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (time[middle] < seconds) low = middle; else high = middle;
  }
  return seconds - time[low] < time[high] - seconds ? low : high;
}

function text(curve, index) {
  const value = curve.values[index];
  if (value === null) return `${curve.name} –`;
  return `${curve.name} ${value}` + (curve.sigma ? ` ± ${curve.sigma[index]}` : "");
}

function show(index) {
  for (const plot of plots) {
    const cursor = plot.querySelector(".cursor");
    cursor.style.display = index === null ? "none" : "block";
    if (index !== null) cursor.style.left = `${100 * time[index] / (span || 1)}%`;
    const output = plot.parentElement.querySelector("output");
    if (!output) continue;
    const curves = charts[output.dataset.chart];
    output.value = index === null ? "" :
      `${time[index]} s: ` + curves.map((curve) => text(curve, index)).join(", ");
  }
}

for (const plot of plots) {
  plot.addEventListener("pointermove", (event) => {
    const box = plot.getBoundingClientRect();
    show(nearest((event.clientX - box.left) / box.width * (span || 1)));
  });
  plot.addEventListener("pointerleave", () => show(null));
}
