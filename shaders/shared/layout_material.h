/* Materials and textures on the device; part of shaders/shared/layout.h.
 *
 * Only surfaces that kernels read are there: surfaces that may let rays through, and surfaces whose emission has a
 * texture. A scene with neither has address 0 everywhere. Once paths are traced, all surfaces are there, with their
 * gloss. */

struct kiln_gpu_material { /* struct kiln_material, with its index in the scene */
    KILN_REAL32 base_alpha, alpha_cutoff, emission[3];
    KILN_WORD alpha_mode;
    KILN_WORD base_color_texture, emission_texture; /* KILN_GPU_NONE: none */
    KILN_REAL32 base_color[3];                      /* diffuse part: base colour times (1 - metallic) */
    KILN_REAL32 transmission;
    KILN_WORD transmission_texture;
    KILN_REAL32 seen_color[3]; /* the base colour itself, with which the camera sees metals */
    KILN_STRUCT kiln_pane pane;
};
KILN_SIZE_IS(kiln_gpu_material, 80);

struct kiln_gpu_texture { /* struct kiln_texture */
    KILN_ADDRESS texels;  /* words of RGBA, red lowest; 0: no kernel reads this texture */
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

/* Colours with textures; those of surfaces that may let rays through, with their transmission; emission. */
#define KILN_TEXTURED_COLOR 1u
#define KILN_TEXTURED_PASSAGE 2u
#define KILN_TEXTURED_EMISSION 4u

/* ---- materials that are not only diffuse (struct kiln_gloss of worker/scene/scene.h); asked for by paths ---- */

/* Uses of a texture (enum kiln_gloss_use) */
#define KILN_GPU_GLOSS_METALLIC 0u
#define KILN_GPU_GLOSS_ROUGHNESS 1u
#define KILN_GPU_GLOSS_TRANSMISSION 2u
#define KILN_GPU_GLOSS_SPECULAR 3u
#define KILN_GPU_GLOSS_SPECULAR_COLOR 4u
#define KILN_GPU_GLOSS_COAT 5u
#define KILN_GPU_GLOSS_COAT_ROUGHNESS 6u
#define KILN_GPU_GLOSS_ANISOTROPY 7u
#define KILN_GPU_GLOSS_USES 8u

struct kiln_gpu_gloss_texture { /* struct kiln_gloss_texture */
    KILN_WORD texture, channel;
    KILN_REAL32 transform[6];
};
KILN_SIZE_IS(kiln_gpu_gloss_texture, 32);

#define KILN_GPU_GLOSS_TAKEN 1u  /* set: gloss is used; else the material is diffuse, and no other bit is set */
#define KILN_GPU_GLOSS_VOLUME 2u /* faces bound a volume */
#define KILN_GPU_GLOSS_MIRROR 4u
#define KILN_GPU_GLOSS_PHONG 8u
#define KILN_GPU_GLOSS_TEXTURED 16u  /* has at least one texture */
#define KILN_GPU_GLOSS_TRANSMITS 32u /* may transmit light */
#define KILN_GPU_GLOSS_PREPARED 64u  /* its lobes are constant but for colour: see `lobes` */
#define KILN_GPU_GLOSS_DYED 128u     /* prepared lobes take the surface's colour, else their own */

struct kiln_gpu_gloss { /* struct kiln_gloss of the material of the same index */
    KILN_WORD flags;
    KILN_REAL32 metallic, roughness, specular, specular_color[3], transmission, filter_color[3];
    KILN_REAL32 eta[3];                                     /* index of refraction for red, green and blue */
    KILN_REAL32 attenuation_color[3], attenuation_distance; /* m; 0: the body absorbs nothing */
    KILN_REAL32 coat, coat_roughness, anisotropy, exponent;
    KILN_REAL32 turn_cosine, turn_sine; /* of anisotropy_rotation */
    KILN_STRUCT kiln_gpu_gloss_texture textures[KILN_GPU_GLOSS_USES];
    KILN_WORD brushed[2], trapped[2]; /* struct kiln_bsdf_tables, unless PREPARED */
};
KILN_SIZE_IS(kiln_gpu_gloss, 368);

struct kiln_gpu_gloss_place {
    KILN_REAL32 at[6]; /* texture coordinates of a coating's corners, for the textures of its gloss */
};
KILN_SIZE_IS(kiln_gpu_gloss_place, 24);

struct kiln_gpu_materials {
    KILN_ADDRESS materials, textures;
    KILN_ADDRESS coatings;
    /* index of the coating of world triangle slot_first + i, with KILN_GPU_FLIPPED; KILN_GPU_NONE: none */
    KILN_ADDRESS slots;
    KILN_ADDRESS linear_of_srgb; /* 256 floats */
    KILN_WORD slot_first, reserved;
    KILN_ADDRESS glosses;      /* of each material; 0: all are diffuse */
    KILN_ADDRESS gloss_places; /* of each coating; 0: textures are read at (0, 0) */
    KILN_ADDRESS lobes;        /* struct kiln_bsdf_lobes of each material that is PREPARED */
    KILN_ADDRESS normals; /* three floats, unit, of each world triangle that is not opaque; 0: there are no panes */
};
KILN_SIZE_IS(kiln_gpu_materials, 80);
