// --- a motion: play, pause, and its time ---------------------------------------------------------------------------
function shareOfSlider() { return (state.time - DATA.t0) / (DATA.t1 - DATA.t0); }
function timeSpanOfSlider() { return [DATA.t0, DATA.t1]; }
function slideTo(share) { seek(DATA.t0 + share * (DATA.t1 - DATA.t0)); }

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
// Move by frames.
function stepBy(count) {
  setPlaying(false);
  seek(timeOf(count < 0 ? Math.ceil(frameOf(state.time) - 1e-6) + count : Math.floor(frameOf(state.time) + 1e-6) + count));
}

// a recorded motion cannot be pulled at, and has no values of its own
function grab() { return false; }
function drag() { }
function release() { }
function drawHint() { }
const addressOfModel = () => [], takeAddressOfModel = asked => { if (asked.has("t")) state.time = Math.min(Math.max(Number(asked.get("t")), DATA.t0), DATA.t1); };

element("precision").textContent = "Numbers, curves and poses are those of the motion at any time; numbers to " + DATA.precision +
  " digits of the largest value of each.";
Object.assign(KEYS, { Home: () => { seek(DATA.t0); }, End: () => { seek(DATA.t1); }, l: () => { element("loop").click(); } });

begin();
window.mechanism = Object.defineProperties({ seek: seek }, Object.getOwnPropertyDescriptors(controls));
