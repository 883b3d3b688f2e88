/* The furnace: a closed convex box whose inner walls emit the same radiance L everywhere and have the albedo R. The
 * irradiance is E = pi L / (1 - R) at every point: pi L from the walls' own light, and the fraction R of E again from
 * each bounce. */
#include "coordinator/generate/camera.h"
#include "coordinator/generate/scenes.h"

int kiln_generate_furnace(struct kiln_glb *glb, const struct kiln_generator *self,
                          const struct kiln_generate_params *params, struct kiln_error *error)
{
    const float albedo = (float)params->albedo;
    const struct kiln_glb_material wall = {
        .name = "wall", .base_color = {albedo, albedo, albedo}, .emission = {1, 1, 1}, .roughness = 1};
    struct kiln_palette palette = {.table = &wall};
    struct kiln_shape shape = {0};
    uint32_t mesh = 0;
    kiln_shape_box(&shape, 0, dvec3(0, 0, 0), dvec3(1, 1, 1), 0, true);
    int status;
    KILN_TRY(kiln_shape_add(&shape, glb, "furnace", &palette, &mesh, error));
    KILN_TRY(kiln_glb_add_node(glb, "furnace", mesh, NULL, error));
    KILN_TRY(kiln_generate_camera(glb, dvec3(0.9, 0.6, 0.9), dvec3(0.2, 0.4, 0.2), 1.0, 1, error));
    KILN_TRY(kiln_glb_set_note(glb, self->description, error));
end:
    kiln_shape_clear(&shape);
    return status;
}
