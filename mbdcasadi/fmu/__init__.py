"""A mechanism as a functional mock-up unit (FMI 2.0 and 3.0): co-simulation and model exchange.

======================  ====================================================================
``export``              the arguments, checked
``functions``           the equations, outputs and start as functions that are written as C
``variables``           names, units and value references
``description``         ``modelDescription.xml`` and ``buildDescription.xml``
``sources``             the C files
``archive``             the binary of this machine, and the archive
``c``                   the parts in C that are the same for every mechanism
======================  ====================================================================
"""
