/* Memory layout for rays of the gather and the weighed pass whose chains are followed separately (gather_chains.glsl).
 * The kernel defines APART_ROOM, the address of this memory; APART_POINTS, the number of points in the chunk;
 * APART_SAMPLES and APART_ROWS, the numbers of samples and of slices per point; and APART_RAY_BYTES, the size of a
 * ray's data. The memory contains the number of chains; APART_ROWS words per point, for its slices; the list of chains,
 * with room for every ray; and the data of each ray. Rays are sorted by sample, then by point. */
KILN_ARRAY(ApartWords, uint, 4);
KILN_ARRAY(ApartRays, kiln_gpu_apart_ray, 4);
KILN_ARRAY(ApartWeighedRays, kiln_gpu_apart_weighed_ray, 4);
KILN_ARRAY(ApartFound, kiln_gpu_apart_found, 4);

#define APART_COUNT ApartWords(APART_ROOM).at[0]

/* Address of the word of a point's slice: its first sample that met gloss; KILN_GPU_NONE: none. */
uint64_t apart_slice(uint row, uint point)
{
    return APART_ROOM + KILN_GPU_APART_COUNT_BYTES + 4ul * (uint64_t(row) * APART_POINTS + point);
}

/* Address of the list of rays at whose hits chains begin; each is sample * APART_POINTS + point. */
uint64_t apart_list() { return apart_slice(APART_ROWS, 0u); }

/* Address of a ray's data. Before its chain is followed: struct kiln_gpu_apart_ray, or in the weighed pass struct
 * kiln_gpu_apart_weighed_ray; afterwards struct kiln_gpu_apart_found. */
uint64_t apart_numbered(uint number)
{
    return apart_list() + 4ul * (uint64_t(APART_SAMPLES) * APART_POINTS) + APART_RAY_BYTES * uint64_t(number);
}
uint64_t apart_ray(uint k, uint point) { return apart_numbered(k * APART_POINTS + point); }
