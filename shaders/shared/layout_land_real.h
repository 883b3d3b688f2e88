/* State of unfinished light paths that land, in the device's `real`: included by GLSL, and by C for double, with
 * KILN_STORED_REAL and KILN_STORED_NAME set. */

/* Supplement to the struct kiln_gpu_subpath of the slot, which holds the ray to the next surface. */
struct KILN_STORED_NAME(kiln_gpu_land_path) {
    KILN_STORED_REAL flux[3]; /* W, at the lamp */
    /* origin of the first ray, m (struct kiln_aimed_ray); after it has hit its target a struct kiln_caustic_landing,
     * and padding */
    KILN_STORED_REAL place_or_sums[3];
    KILN_STORED_REAL cosine, range; /* first ray: members of struct kiln_aimed_ray */
    KILN_WORD light, triangle;      /* first ray: members of struct kiln_aimed_ray */
    KILN_WORD aim;
    KILN_WORD key, number; /* key of random numbers; the path's number within its aim, modulo 2^32 */
    KILN_WORD flags;       /* KILN_GPU_LAND_IS_POINT and so on */
};
