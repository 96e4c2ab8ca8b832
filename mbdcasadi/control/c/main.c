/* Steps of the controller in the state of the assembled mechanism, which is held: a table of its inputs. */
#include <stdio.h>

#include "controller.h"

static controller memory;

int main(void) {
  double state[CONTROLLER_STATES], parameters[CONTROLLER_SIZE(CONTROLLER_PARAMETERS)];
  double inputs[CONTROLLER_SIZE(CONTROLLER_INPUTS)];
  controller_example(state, parameters);
  controller_reset(&memory);
  for (int k = 0; k < 5; ++k) {
    const double time = k * CONTROLLER_SAMPLE;
    const int status = controller_step(&memory, time, state, parameters, inputs);
    printf("%.17g s, status %d:", time, status);
    for (int i = 0; i < CONTROLLER_INPUTS; ++i) printf(" %.17g", inputs[i]);
    printf("\n");
  }
  return 0;
}
