/* What a bake has in its hands when light transport is done and files are to be written. */
#ifndef KILN_COORDINATOR_FIELD_RESULT_H
#define KILN_COORDINATOR_FIELD_RESULT_H

#include <mpi.h>

#include "coordinator/field/packed_error.h"
#include "coordinator/field/units.h"
#include "worker/backend/backend.h"
#include "worker/pass/probes.h"

/* All arrays are this rank's share (surface->count points, in global order from surface->first) and in
 * units->irradiance. */
struct kiln_bake_result {
    const struct kiln_units *units;
    MPI_Comm communicator; /* one-sided calls are not used; every rank takes part in every output call */
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_surface *surface;
    const float *direct;          /* 3 a point, about the shading normal */
    const float *indirect;        /* 3 a point */
    const uint16_t *error;        /* standard error of the luminance of direct + indirect, 1 a point, kiln_error_pack */
    const uint64_t *radiosity;    /* all points: packed total radiosity (albedo x irradiance), for views and probes */
    const struct kiln_stop *stop; /* what asks to end before all files are written; NULL: nothing does */
};

/* The irradiance volume: a regular grid of probes, this rank's share of them a contiguous range of z-major order
 * (index = (z * size[1] + y) * size[0] + x). */
struct kiln_volume_result {
    uint64_t size[3];
    double origin[3];  /* world, m: position of probe (0,0,0) */
    double spacing[3]; /* m */
    uint64_t first, count;
    const struct kiln_probe_result *probes; /* own */
};

#endif
