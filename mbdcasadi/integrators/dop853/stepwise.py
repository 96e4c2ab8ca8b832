class StepwiseRun:
    def __init__(self, system, watched):
        raise NotImplementedError
