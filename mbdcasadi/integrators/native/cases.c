/* Many runs one after the other, by the `mbd_advance` of the method above. */

static int write_outputs(run_t* run, const cases_t* cases, double t, const double* x, const double* channel,
                         double* values) {
  const stretch_t* task = run->task;
  const integer n = run->n;
  run->channel = channel;
  if (cases->output_needs_dynamics) find_accelerations(run, t, x, run->accelerations, run->moved, run->lam);
  const double* arg[8] = {&t, x, x + n, run->accelerations, x + 2 * n, run->lam, run->u, task->p};
  double* res[1] = {values};
  evaluate(&cases->output, arg, res, cases->work);
  for (integer i = 0; i < cases->outputs; ++i)
    if (!isfinite(values[i])) return 0;
  return 1;
}

/* Run the cases from one to before another; `common` holds what all share, and places for the states of one. */
void mbd_run_cases(run_t* run, const stretch_t* common, const cases_t* cases, integer first, integer last) {
  for (integer c = first; c < last; ++c) {
    const integer shift = c * cases->stride;
    stretch_t task = *common;
    task.x = cases->starts + c * run->n_x;
    task.p = cases->p + c * cases->parameters;
    task.levels = cases->levels_of + c * cases->levels;
    task.times = cases->times + shift;
    task.stops = cases->stops + shift;
    task.channels = cases->channels + shift * task.channel;
    task.max_step = cases->stride ? cases->max_step[c] : cases->max_step[0];
    const int* requested = cases->requested + shift;
    cases->status[c] = mbd_advance(run, &task);
    cases->reached[c] = task.time;
    if (task.status == HALTED) {
      for (; c < last; ++c) cases->status[c] = HALTED;
      return;
    }
    if (task.status != DONE) continue;
    run->task = &task;
    double* values = cases->values + c * cases->rows * cases->outputs;
    int whole = write_outputs(run, cases, task.start, task.x, task.channels, values);
    for (integer r = 0; whole && r < task.recorded; ++r) {
      const integer k = task.out_index[r];
      if (k < 0 || !requested[k]) continue;
      values += cases->outputs;
      whole = write_outputs(run, cases, task.out_times[r], task.out_x + r * run->n_x,
                            task.channels + k * task.channel, values);
    }
    if (!whole) cases->status[c] = NOT_FINITE;
  }
}
