/* Rays of the gather and the weighed pass whose chains are followed apart (gather_chains.glsl): where what is kept
 * of them lies. The kernel defines APART_ROOM, the address of that, APART_POINTS, how many points the chunk has,
 * APART_SAMPLES and APART_ROWS, how many samples and slices a point, and APART_RAY_BYTES of a ray. There lie the
 * number of chains, so many words a point for its slices, one for each ray's place in the list of chains, and what
 * is kept of each ray; sample by sample, in which points come one after the other. */
KILN_ARRAY(ApartWords, uint, 4);
KILN_ARRAY(ApartRays, kiln_gpu_apart_ray, 4);
KILN_ARRAY(ApartWeighedRays, kiln_gpu_apart_weighed_ray, 4);
KILN_ARRAY(ApartFound, kiln_gpu_apart_found, 4);

#define APART_COUNT ApartWords(APART_ROOM).at[0]

/* Address of a point's slice: its first sample that met gloss; KILN_GPU_NONE: there is none. */
uint64_t apart_slice(uint row, uint point)
{
    return APART_ROOM + KILN_GPU_APART_COUNT_BYTES + 4ul * (uint64_t(row) * APART_POINTS + point);
}

/* The list of rays at whose hits chains begin, by numbers sample * APART_POINTS + point. */
uint64_t apart_list() { return apart_slice(APART_ROWS, 0u); }

/* Address of a ray's data: until its chain has been followed, struct kiln_gpu_apart_ray, or of the weighed pass struct
 * kiln_gpu_apart_weighed_ray; struct kiln_gpu_apart_found then. */
uint64_t apart_numbered(uint number)
{
    return apart_list() + 4ul * (uint64_t(APART_SAMPLES) * APART_POINTS) + APART_RAY_BYTES * uint64_t(number);
}
uint64_t apart_ray(uint k, uint point) { return apart_numbered(k * APART_POINTS + point); }
