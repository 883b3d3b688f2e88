/* Cells of photons and their buckets. Needs BOTH and `real`. */
#include "shaders/shared/bidirectional.h"

/* The cell that contains a point, after a shift by a fraction of a cell. */
ivec3 photon_cell(vec3 p, real shift)
{
    const real radius = real(BOTH.radius);
    return ivec3(kiln_photon_cell(p.x, radius, shift), kiln_photon_cell(p.y, radius, shift),
                 kiln_photon_cell(p.z, radius, shift));
}

uint photon_bucket(ivec3 cell) { return kiln_photon_bucket(cell.x, cell.y, cell.z, BOTH.bucket_mask); }
