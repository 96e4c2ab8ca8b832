// --- a motion: play, pause, the slider of time ---------------------------------------------------------------------
function showControls() {
  element("slider").value = (state.time - DATA.t0) / (DATA.t1 - DATA.t0);
  element("slider").setAttribute("aria-valuetext", element("clock").textContent);
}

function seek(time) {
  state.time = Math.min(Math.max(time, DATA.t0), DATA.t1);
  show();
}

function setPlaying(on) {
  if (on && state.time >= DATA.t1) state.time = DATA.t0;
  showPlaying(on);
  if (on) window.requestAnimationFrame(step);
}

function step(now) {
  if (!state.playing) return;
  if (shownAt !== null) {
    let time = state.time + (now - shownAt) / 1000 * DATA.speed * state.factor;
    if (time > DATA.t1) {
      if (state.loop) time = DATA.t0 + (time - DATA.t1) % (DATA.t1 - DATA.t0);
      else { seek(DATA.t1); setPlaying(false); return; }
    }
    seek(time);
  }
  shownAt = now;
  window.requestAnimationFrame(step);
}

// a recorded motion cannot be pulled at
function grab() { return false; }
function drag() { }
function release() { }

element("precision").textContent = "Numbers, curves and poses are those of the motion at any time; numbers to " + DATA.precision +
  " digits of the largest value of each.";
element("slider").addEventListener("input", () => { seek(DATA.t0 + Number(element("slider").value) * (DATA.t1 - DATA.t0)); });

Object.assign(KEYS, {
  ArrowLeft: event => { setPlaying(false); seek(timeOf(Math.ceil(frameOf(state.time) - 1e-6) - (event.shiftKey ? 10 : 1))); },
  ArrowRight: event => { setPlaying(false); seek(timeOf(Math.floor(frameOf(state.time) + 1e-6) + (event.shiftKey ? 10 : 1))); },
  Home: () => { seek(DATA.t0); },
  End: () => { seek(DATA.t1); },
  l: () => { element("loop").click(); },
});

// A plot is pointed at: the motion goes to that time.
function scrub(plot, event) {
  if (!event.buttons) return;
  setPlaying(false);
  const left = plot.canvas.getBoundingClientRect().left;
  const share = (event.clientX - left - MARGIN.left) / (plot.width - MARGIN.left - MARGIN.right);
  seek(DATA.t0 + share * (DATA.t1 - DATA.t0));
}

begin();
window.mechanism = Object.defineProperties({ seek: seek }, Object.getOwnPropertyDescriptors(controls));
