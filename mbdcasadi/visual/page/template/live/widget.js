// A live page in a notebook: values go to the page, and what moves there comes back.
const TAKEN = ["values", "time", "playing", "q", "v"], PACE = 100;   // milliseconds between two reports of a mechanism that runs

function render({ model, el }) {
  const frame = document.createElement("iframe");
  frame.srcdoc = model.get("html");
  frame.setAttribute("sandbox", "allow-scripts allow-downloads");
  Object.assign(frame.style, { width: "100%", height: model.get("height") + "px", border: "0" });
  let taking = false, last = -Infinity;
  const give = () => {
    if (!taking) frame.contentWindow.postMessage({ mechanism: { values: model.get("values"), playing: model.get("playing") } }, "*");
  };
  const take = event => {
    const told = event.source === frame.contentWindow && event.data && event.data.mechanism;
    if (!told || (told.playing && performance.now() - last < PACE)) return;
    last = performance.now();
    taking = true;                                            // what comes from the page does not go back to it
    for (const name of TAKEN) if (JSON.stringify(model.get(name)) !== JSON.stringify(told[name])) model.set(name, told[name]);
    taking = false;
    model.save_changes();
  };
  window.addEventListener("message", take);
  frame.addEventListener("load", give);
  model.on("change:values", give);
  model.on("change:playing", give);
  el.append(frame);
  return () => { window.removeEventListener("message", take); };
}
export default { render };
