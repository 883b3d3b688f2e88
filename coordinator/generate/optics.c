/* Two scenes of mirrors and glass whose light is known.
 *
 * mirrors: a room of 4 x 3 x 5 m. Its four walls are plane mirrors of reflectance R = 0.9, its ceiling is black, its
 * floor is grey. The lamp, a point of 20 W/sr at (1.5, 2, 2.2), has an image (8 i +- 1.5, 2, 10 k +- 2.2) for all whole
 * i and k, by |2 i| or |2 i - 1| reflections at the walls of constant x (for + and -), and as many of k at the others.
 * No light comes back from the ceiling, so that the irradiance of the floor at (x, 0, z) is
 *
 *   E = sum over images of  20 R^reflections 2 / (dx^2 + 2^2 + dz^2)^(3/2)
 *
 * prism: an equilateral prism of dense flint glass (index 1.728, Abbe number 28.5, as Schott's SF10), and a beam that
 * passes it parallel to its base, which is where it bends light least. It leaves 59.5 degrees from its way, and the
 * colours of the F and C lines leave 2.9 degrees apart. */
#include "coordinator/generate/camera.h"
#include "coordinator/generate/scenes.h"

enum { WALL, DARK, MIRROR, GLASS, MATERIALS };

static const struct kiln_glb_material table[MATERIALS] = {
    [WALL] = {.name = "wall", .base_color = {0.5f, 0.5f, 0.5f}, .roughness = 1},
    [DARK] = {.name = "dark", .base_color = {0, 0, 0}, .roughness = 1},
    [MIRROR] = {.name = "mirror", .base_color = {0.9f, 0.9f, 0.9f}, .metallic = 1},
    [GLASS] = {.name = "flint_glass",
               .base_color = {1, 1, 1},
               .transmissive = true,
               .ior = 1.728f,
               .thickness = 0.3f,
               .dispersion = 0.70175f},
};

static const double white[3] = {1, 1, 1};

static int add(struct kiln_glb *glb, struct kiln_shape *shape, const char *name, struct kiln_palette *palette,
               struct kiln_error *error)
{
    uint32_t mesh = 0;
    const int status = kiln_shape_add(shape, glb, name, palette, &mesh, error);
    return status != KILN_OK ? status : kiln_glb_add_node(glb, name, mesh, NULL, error);
}

/* Adds the named faces of a room from the origin to `size`, facing inwards; each has one material. */
static int add_room(struct kiln_glb *glb, struct kiln_palette *palette, struct kiln_dvec3 size, uint32_t walls,
                    uint32_t ceiling, struct kiln_error *error)
{
    const double x = size.x, y = size.y, z = size.z;
    const struct {
        const char *name;
        uint32_t material;
        struct kiln_dvec3 corner[4];
    } faces[] = {{"floor", WALL, {{0, 0, 0}, {0, 0, z}, {x, 0, z}, {x, 0, 0}}},
                 {"ceiling", ceiling, {{0, y, 0}, {x, y, 0}, {x, y, z}, {0, y, z}}},
                 {"left", walls, {{0, 0, 0}, {0, y, 0}, {0, y, z}, {0, 0, z}}},
                 {"right", walls, {{x, 0, 0}, {x, 0, z}, {x, y, z}, {x, y, 0}}},
                 {"back", walls, {{0, 0, 0}, {x, 0, 0}, {x, y, 0}, {0, y, 0}}},
                 {"front", walls, {{0, 0, z}, {0, y, z}, {x, y, z}, {x, 0, z}}}};
    int status = KILN_OK;
    for (size_t i = 0; i < sizeof faces / sizeof faces[0] && status == KILN_OK; i++) {
        struct kiln_shape shape = {0};
        const struct kiln_dvec3 *c = faces[i].corner;
        kiln_shape_face(&shape, faces[i].material, c[0], c[1], c[2], c[3]);
        status = add(glb, &shape, faces[i].name, palette, error);
    }
    return status;
}

int kiln_generate_mirrors(struct kiln_glb *glb, const struct kiln_generator *self,
                          const struct kiln_generate_params *params, struct kiln_error *error)
{
    (void)params;
    struct kiln_palette palette = {.table = table};
    const struct kiln_glb_placement lamp = {.translation = {1.5, 2, 2.2}};
    int status;
    KILN_TRY(add_room(glb, &palette, dvec3(4, 3, 5), MIRROR, DARK, error));
    KILN_TRY(kiln_glb_add_point(glb, "lamp", white, 20, &lamp, error));
    KILN_TRY(kiln_generate_camera(glb, dvec3(3.5, 1.7, 4.5), dvec3(1.5, 0.6, 1.5), 1.0, 1, error));
    KILN_TRY(kiln_glb_set_note(glb, self->description, error));
end:
    return status;
}

/* Adds the prism: its axis is upright, its base faces -z and its apex +z. */
static int add_prism(struct kiln_glb *glb, struct kiln_palette *palette, struct kiln_dvec3 centre, double side,
                     double height, struct kiln_error *error)
{
    const double depth = side * sqrt(0.75),
                 outline[3][2] = {{-0.5 * side, -depth / 3}, {0, 2 * depth / 3}, {0.5 * side, -depth / 3}};
    struct kiln_dvec3 low[3], high[3];
    struct kiln_shape shape = {0};
    for (int i = 0; i < 3; i++) {
        low[i] = dvec3(centre.x + outline[i][0], centre.y - 0.5 * height, centre.z + outline[i][1]);
        high[i] = dvec3(low[i].x, centre.y + 0.5 * height, low[i].z);
    }
    kiln_shape_triangle(&shape, GLASS, high[0], high[1], high[2]);
    kiln_shape_triangle(&shape, GLASS, low[0], low[2], low[1]);
    for (int i = 0; i < 3; i++)
        kiln_shape_face(&shape, GLASS, low[i], low[(i + 1) % 3], high[(i + 1) % 3], high[i]);
    return add(glb, &shape, "prism", palette, error);
}

int kiln_generate_prism(struct kiln_glb *glb, const struct kiln_generator *self,
                        const struct kiln_generate_params *params, struct kiln_error *error)
{
    (void)params;
    struct kiln_palette palette = {.table = table};
    const struct kiln_dvec3 centre = dvec3(2.5, 1.2, 2.2);
    const double side = 0.6, depth = side * sqrt(0.75);
    /* Direction of the beam. Inside, it goes along +x at half the prism's depth. Outside, it leans by the angle of
     * incidence less half the apex angle; the sine of the angle of incidence is the index times the sine of half the
     * apex angle. */
    const double lean = asin((double)table[GLASS].ior * 0.5) - KILN_PI / 6;
    const struct kiln_dvec3 towards = dvec3(cos(lean), 0, sin(lean)),
                            entry = dvec3(centre.x - side / 4, centre.y, centre.z + depth / 6);
    const struct kiln_dvec3 lamp = dvec3_sub(entry, dvec3_scale(towards, 2));
    struct kiln_glb_placement placement = {.translation = {lamp.x, lamp.y, lamp.z}};
    kiln_generate_look(towards, placement.rotation);
    int status;
    KILN_TRY(add_room(glb, &palette, dvec3(5.5, 2.4, 4), WALL, WALL, error));
    KILN_TRY(add_prism(glb, &palette, centre, side, 0.6, error));
    KILN_TRY(kiln_glb_add_spot(glb, "beam", white, 1000, 0.004, 0.006, &placement, error));
    KILN_TRY(kiln_generate_camera(glb, dvec3(1.2, 2.0, 3.7), dvec3(5.4, 1.1, 1.0), 1.0, 1, error));
    KILN_TRY(kiln_glb_set_note(glb, self->description, error));
end:
    return status;
}
