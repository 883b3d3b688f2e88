/* Materials and textures on the device; part of shaders/shared/layout.h.
 *
 * Only what kernels ask for is there: surfaces that may let rays through, and surfaces whose emission has a texture. A
 * scene with neither has address 0 everywhere. Once paths are traced, all surfaces are there. */

struct kiln_gpu_material { /* struct kiln_material, with its index in the scene */
    KILN_REAL32 base_alpha, alpha_cutoff, emission[3];
    KILN_WORD alpha_mode;
    KILN_WORD base_color_texture, emission_texture; /* KILN_GPU_NONE: none */
    KILN_REAL32 base_color[3];                      /* times what is not metal */
    KILN_REAL32 transmission;
    KILN_WORD transmission_texture;
    KILN_REAL32 seen_color[3]; /* the base colour itself: as what a camera sees metals */
};
KILN_SIZE_IS(kiln_gpu_material, 64);

struct kiln_gpu_texture { /* struct kiln_texture */
    KILN_ADDRESS texels;  /* words of RGBA, red lowest; 0: no kernel asks for this texture */
    KILN_WORD width, height, srgb, nearest, wrap_u, wrap_v;
};
KILN_SIZE_IS(kiln_gpu_texture, 32);

/* A stored triangle, shared by all instances of its mesh; corners in stored order. */
struct kiln_gpu_coating {
    KILN_REAL32 base[6], emission[6]; /* texture coordinates, u and v of each corner */
    KILN_WORD colors[3];              /* RGBA of each corner, red lowest */
    KILN_WORD material;
};
KILN_SIZE_IS(kiln_gpu_coating, 64);

#define KILN_GPU_FLIPPED 0x80000000u

struct kiln_gpu_materials {
    KILN_ADDRESS materials, textures;
    KILN_ADDRESS coatings;
    /* of world triangle slot_first + i: index of its coating, with KILN_GPU_FLIPPED; KILN_GPU_NONE: none */
    KILN_ADDRESS slots;
    KILN_ADDRESS linear_of_srgb; /* 256 floats */
    KILN_WORD slot_first, reserved;
};
KILN_SIZE_IS(kiln_gpu_materials, 48);
