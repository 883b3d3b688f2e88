/* The scenes that `kiln generate` makes. All are the project's own work; the same parameters give the same bytes. */
#ifndef KILN_COORDINATOR_GENERATE_SCENES_H
#define KILN_COORDINATOR_GENERATE_SCENES_H

#include "coordinator/generate/glb.h"
#include "coordinator/generate/shape.h"

/* Which parameters a scene takes. */
enum { KILN_TAKES_TRIANGLES = 1, KILN_TAKES_GRID = 2, KILN_TAKES_ALBEDO = 4, KILN_TAKES_PARTS = 8 };

/* Parameters. Zero means the default given in the scene's description; albedo is always given. */
struct kiln_generate_params {
    uint64_t triangles;
    uint32_t columns, rows;
    double albedo;
    uint64_t seed;
    bool distinct;        /* no two things are alike, so that nothing is an instance */
    uint32_t part, parts; /* the file has part `part` of `parts` of the scene; the parts together are the whole scene */
};

struct kiln_generator {
    const char *name;
    const char *description; /* one line */
    uint32_t takes;
    int (*build)(struct kiln_glb *glb, const struct kiln_generator *self, const struct kiln_generate_params *params,
                 struct kiln_error *error);
};

extern const struct kiln_generator kiln_generators[];
extern const size_t kiln_generator_count;

/* The build functions. One may serve several scenes and then checks self->name. */
int kiln_generate_cornell(struct kiln_glb *glb, const struct kiln_generator *self,
                          const struct kiln_generate_params *params, struct kiln_error *error);
int kiln_generate_furnace(struct kiln_glb *glb, const struct kiln_generator *self,
                          const struct kiln_generate_params *params, struct kiln_error *error);
int kiln_generate_city(struct kiln_glb *glb, const struct kiln_generator *self,
                       const struct kiln_generate_params *params, struct kiln_error *error);
int kiln_generate_rooms(struct kiln_glb *glb, const struct kiln_generator *self,
                        const struct kiln_generate_params *params, struct kiln_error *error);
int kiln_generate_lights(struct kiln_glb *glb, const struct kiln_generator *self,
                         const struct kiln_generate_params *params, struct kiln_error *error);

int kiln_generate_mirrors(struct kiln_glb *glb, const struct kiln_generator *self,
                          const struct kiln_generate_params *params, struct kiln_error *error);
int kiln_generate_prism(struct kiln_glb *glb, const struct kiln_generator *self,
                        const struct kiln_generate_params *params, struct kiln_error *error);

#endif
