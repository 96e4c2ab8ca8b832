"""Arguments of analyses: inputs, parameters and times in every form that is accepted."""
