/* The integrator "cells": every surface point gathers from all others, bounce after bounce; each bounce gathers the
 * radiosity of the one before. It has two schedules (schedule.h). */
#ifndef KILN_COORDINATOR_INTEGRATE_CELLS_CELLS_H
#define KILN_COORDINATOR_INTEGRATE_CELLS_CELLS_H

#include "coordinator/integrate/integrator.h"

/* Indices into its roles. */
enum { KILN_CELLS_DIRECT, KILN_CELLS_BOUNCE, KILN_CELLS_FINAL, KILN_CELLS_PILOT, KILN_CELLS_CAUSTIC };

/* The random stream of the final gather; a bounce has its number. */
enum { KILN_CELLS_FINAL_STREAM = 0xffff };

/* The random stream of direct light after a pilot; the pilot, and direct light without one, have 0. */
enum { KILN_CELLS_DIRECT_STREAM = 1 };

extern const struct kiln_integrator kiln_integrator_cells;

#endif
