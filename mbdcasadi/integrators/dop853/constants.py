"""Constants of the decisions between steps."""

from __future__ import annotations

#: Share of the estimated size that a step has, and the most by which a step lets the next one grow in the prediction
#: from both (measured on five models, at equal error: 6 % fewer evaluations than by the last step alone with 0.9).
SAFETY, MOST_GAIN = 0.85, 1.8
#: Correction by the projection, in tolerances, from which a step is repeated.
DRIFT = 10.0
#: Correction, relative to 1 + |x|, that counts for none: rounding divided by a singular value.
SLIGHT = 1e-9
#: Product of step and largest eigenvalue up to which steps are taken (what is stiff grows from 6.1 on, and the estimate
#: of the error shows that late), and from which stability limits them.
STABLE, STABILITY = 4.5, 4.0
#: Difference of two stages at one time, relative to the tolerances, from which it shows the largest eigenvalue; and the
#: part of that which holds in the next step.
QUIET, FADING = 1e-2, 0.9
#: Steps off that limit after which those at it are forgotten.
FORGOTTEN = 6
#: Steps near to a singular pose after which this is reported at the latest.
NEAR_STEPS = 200
#: Size of a quantity that switches, relative to 1 + |x|, below which its sign is rounding.
SAME_SIDE = 1e-12
#: Factor on the estimate of the error of steps that pass a switch, or begin at one (measured: up to 20).
DOUBT = 20.0
#: Ratio of changes of the rates in stages 2 to 5, and in those of the dense output, to those in the other stages from
#: which a step is repeated (along polynomials of degree 5 it is below 5).
OUTLIERS = 10.0
#: Distance from the end of a step to a switch, in its lengths, that a tiny step goes across; trials to come so near,
#: and share of the estimated way that they leave out to end before the switch.
NEARLY, SEARCHES, BEFORE = 1e-6, 24, 1e-7
