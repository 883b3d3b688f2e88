/* The lightmap as a store, on the device; part of shaders/shared/layout.h. worker/scene/surface.h says what its structs
 * are. */

struct kiln_gpu_lightmap { /* struct kiln_lightmap */
    KILN_WORD64 tile_first;
    KILN_WORD width, height, tiles_x, tiles_y, shift, published;
};
KILN_SIZE_IS(kiln_gpu_lightmap, 32);

struct kiln_gpu_divided { /* struct kiln_divided_texel */
    KILN_WORD64 part[KILN_SUBTEXELS];
    KILN_REAL32 lines[KILN_CUT_FLOATS], margin;
    KILN_WORD line_count, codes[2], sides, bit;
    KILN_WORD64 tile;
    KILN_REAL32 within;
    KILN_WORD shown;
};
#define KILN_GPU_DIVIDED_BYTES 120
KILN_SIZE_IS(kiln_gpu_divided, KILN_GPU_DIVIDED_BYTES);

struct kiln_gpu_tile { /* struct kiln_tile, struct kiln_split_tile_run */
    KILN_WORD64 mask, first;
};
KILN_SIZE_IS(kiln_gpu_tile, 16);
