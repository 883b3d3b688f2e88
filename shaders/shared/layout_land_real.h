/* Light paths that land, while they are under way, in the device's `real`: included by GLSL, and by C for double, with
 * KILN_STORED_REAL and KILN_STORED_NAME set. */

/* Beside the struct kiln_gpu_subpath of its slot, which has the rays from one surface to the next. */
struct KILN_STORED_NAME(kiln_gpu_land_path) {
    KILN_STORED_REAL flux[3]; /* W, at the lamp */
    /* where the first ray begins, m (struct kiln_aimed_ray); once that has met its target a struct
     * kiln_caustic_landing, and nothing */
    KILN_STORED_REAL place_or_sums[3];
    KILN_STORED_REAL cosine, range; /* of the first ray, as there */
    KILN_WORD light, triangle;      /* likewise */
    KILN_WORD aim;
    KILN_WORD key, number; /* what random numbers hang on; the number of the path among its aim's, modulo 2^32 */
    KILN_WORD flags;       /* KILN_GPU_LAND_IS_POINT and so on */
};
