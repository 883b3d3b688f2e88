/* Cells of photons, as wide as twice the radius of merging, and the buckets that they fall into:
 * worker/backend/embree/photons.c. Needs BOTH and `real`. */

/* The cell of a place, shifted by a share of a cell. */
ivec3 photon_cell(vec3 p, real shift)
{
    const real scale = real(0.5LF) / real(BOTH.radius);
    return ivec3(int(floor(real(p.x) * scale + shift)), int(floor(real(p.y) * scale + shift)),
                 int(floor(real(p.z) * scale + shift)));
}

uint photon_bucket(ivec3 cell)
{
    return kiln_hash2(kiln_hash2(uint(cell.x), uint(cell.y)), uint(cell.z)) & BOTH.bucket_mask;
}
