#include "coordinator/import/obj.h"

#include <assimp/cfileio.h>
#include <assimp/cimport.h>
#include <assimp/material.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "coordinator/import/assemble.h"
#include "coordinator/import/image.h"
#include "coordinator/import/names.h"
#include "worker/base/memory.h"

enum { PATH_LENGTH = 1024 };

struct reader {
    struct kiln_confine *confine;
    struct kiln_builder *builder;
    struct kiln_error *error;
    int status;
    const struct aiScene *scene;
    struct kiln_names names;
    struct kiln_assembly_counts assembly;
    struct kiln_images images;
    uint64_t not_triangles, without_area_objects;
};

static void take(struct reader *r, int status)
{
    if (r->status == KILN_OK)
        r->status = status;
}

/* ---- files as Assimp opens them ---- */

struct open_file {
    struct kiln_file file;
    size_t at;
};

static size_t file_read(struct aiFile *file, char *buffer, size_t size, size_t count)
{
    struct open_file *f = (struct open_file *)(void *)file->UserData;
    if (size == 0)
        return 0;
    const size_t whole = (f->file.size - f->at) / size < count ? (f->file.size - f->at) / size : count;
    memcpy(buffer, f->file.data + f->at, whole * size);
    f->at += whole * size;
    return whole;
}

static size_t file_write(struct aiFile *file, const char *buffer, size_t size, size_t count)
{
    (void)file;
    (void)buffer;
    (void)size;
    (void)count;
    return 0;
}

static size_t file_tell(struct aiFile *file) { return ((struct open_file *)(void *)file->UserData)->at; }
static size_t file_size(struct aiFile *file) { return ((struct open_file *)(void *)file->UserData)->file.size; }
static void file_flush(struct aiFile *file) { (void)file; }

static enum aiReturn file_seek(struct aiFile *file, size_t offset, enum aiOrigin origin)
{
    struct open_file *f = (struct open_file *)(void *)file->UserData;
    const size_t base = origin == aiOrigin_SET ? 0 : origin == aiOrigin_CUR ? f->at : f->file.size;
    const size_t target = base + offset; /* "backwards" arrives as a huge offset and wraps round to the right place */
    if (target > f->file.size)
        return aiReturn_FAILURE;
    f->at = target;
    return aiReturn_SUCCESS;
}

/* Names in OBJ and MTL files are no URIs: taken as they stand, but for the backslashes of another system. */
static const char *plain_path(const char *name, char path[PATH_LENGTH + 1])
{
    while (name[0] == '.' && (name[1] == '/' || name[1] == '\\'))
        name += 2;
    size_t length = 0;
    for (; name[length] != '\0' && length < PATH_LENGTH; length++)
        path[length] = name[length] == '\\' ? '/' : name[length];
    path[length] = '\0';
    return path;
}

static struct aiFile *file_open(struct aiFileIO *io, const char *name, const char *mode)
{
    struct reader *r = (struct reader *)(void *)io->UserData;
    struct open_file *f = NULL;
    struct aiFile *result = NULL;
    struct kiln_error error = {""};
    char path[PATH_LENGTH + 1], place[160];
    if (r->status != KILN_OK || mode[0] != 'r')
        return NULL;
    (void)snprintf(place, sizeof place, "mtllib '%.100s'", name);
    if (kiln_allocate(&f, 1, sizeof *f, "a file", &error) == KILN_OK && kiln_allocate(&result, 1, sizeof *result, "a file", &error) == KILN_OK &&
        kiln_confine_map(r->confine, r->builder, plain_path(name, path), place, &f->file, &error) == KILN_OK) {
        *result = (struct aiFile){.ReadProc = file_read, .WriteProc = file_write, .TellProc = file_tell, .FileSizeProc = file_size,
                                  .SeekProc = file_seek, .FlushProc = file_flush, .UserData = (aiUserData)(void *)f};
        return result;
    }
    /* Assimp goes on without the file; what was wrong with it fails the import all the same. */
    take(r, kiln_fail(r->error, KILN_BAD_INPUT, "%s", error.message));
    kiln_free(&f);
    kiln_free(&result);
    return NULL;
}

static void file_close(struct aiFileIO *io, struct aiFile *file)
{
    (void)io;
    struct open_file *f = (struct open_file *)(void *)file->UserData;
    kiln_file_unmap(&f->file);
    kiln_free(&f);
    kiln_free(&file);
}

/* ---- materials ---- */

static uint32_t add_texture(struct reader *r, const struct aiMaterial *material, enum aiTextureType type, const char *what)
{
    struct aiString name;
    if (aiGetMaterialTextureCount(material, type) == 0 ||
        aiGetMaterialTexture(material, type, 0, &name, NULL, NULL, NULL, NULL, NULL, NULL) != aiReturn_SUCCESS)
        return KILN_NONE;
    struct kiln_texture texture = {.srgb = 1};
    struct kiln_image image = {0};
    struct kiln_file file;
    char path[PATH_LENGTH + 1], where[640];
    size_t index = KILN_NONE;
    (void)snprintf(where, sizeof where, "%.512s: %s", r->confine->scene, what);
    take(r, kiln_confine_map(r->confine, r->builder, plain_path(name.data, path), what, &file, r->error));
    if (r->status != KILN_OK)
        return KILN_NONE;
    const struct kiln_image_bytes bytes = {.data = file.data, .size = file.size, .any_format = true, .where = where};
    take(r, kiln_image_append(&r->images, &bytes, &image, r->error));
    kiln_file_unmap(&file);
    texture.first = image.first, texture.width = image.width, texture.height = image.height;
    if (r->status == KILN_OK)
        take(r, kiln_builder_append(r->builder, KILN_SECTION_TEXTURES, &texture, 1, &index, r->error));
    return (uint32_t)index;
}

static bool color_of(const struct aiMaterial *material, const char *key, float rgb[3])
{
    struct aiColor4D color;
    if (aiGetMaterialColor(material, key, 0, 0, &color) != aiReturn_SUCCESS)
        return false;
    rgb[0] = color.r, rgb[1] = color.g, rgb[2] = color.b;
    return true;
}

static void check_range(struct reader *r, const char *name, const char *what, const float *values, int count, float high)
{
    for (int i = 0; i < count; i++)
        if (!(values[i] >= 0.0f && values[i] <= high))
            take(r, kiln_fail(r->error, KILN_BAD_INPUT, "%.512s: material '%.80s': %s is %g, outside 0 to %g; repair the material file",
                              r->confine->scene, name, what, (double)values[i], (double)high));
}

static void add_material(struct reader *r, const struct aiMaterial *source)
{
    struct kiln_material material = {.base_color = {0.8f, 0.8f, 0.8f, 1.0f}, .base_color_texture = KILN_NONE, .emission_texture = KILN_NONE,
                                     .transmission_texture = KILN_NONE, .alpha_cutoff = 0.5f, .roughness = 1.0f};
    struct aiString name = {0};
    (void)aiGetMaterialString(source, "?mat.name", 0, 0, &name);
    (void)color_of(source, "$clr.diffuse", material.base_color);
    (void)color_of(source, "$clr.emissive", material.emission);
    ai_real opacity = 1.0f;
    unsigned count = 1;
    if (aiGetMaterialFloatArray(source, "$mat.opacity", 0, 0, &opacity, &count) == aiReturn_SUCCESS)
        material.base_color[3] = (float)opacity;
    check_range(r, name.data, "Kd or d", material.base_color, 4, 1.0f);
    check_range(r, name.data, "Ke", material.emission, 3, 1e30f);
    if (material.base_color[3] < 1.0f)
        material.alpha_mode = KILN_ALPHA_BLEND;
    material.base_color_texture = add_texture(r, source, aiTextureType_DIFFUSE, "map_Kd");
    material.emission_texture = add_texture(r, source, aiTextureType_EMISSIVE, "map_Ke");
    if (material.emission_texture != KILN_NONE && material.emission[0] + material.emission[1] + material.emission[2] == 0.0f)
        material.emission[0] = material.emission[1] = material.emission[2] = 1.0f;
    if (r->status == KILN_OK && aiGetMaterialTextureCount(source, aiTextureType_OPACITY) > 0)
        take(r, kiln_builder_note(r->builder, 1, r->error, "material '%.80s': its opacity map is left out", name.data));
    if (r->status == KILN_OK)
        take(r, kiln_builder_string(r->builder, name.data, strlen(name.data), &material.name, r->error));
    if (r->status == KILN_OK)
        take(r, kiln_builder_append(r->builder, KILN_SECTION_MATERIALS, &material, 1, NULL, r->error));
}

/* ---- meshes ---- */

static void read_corners(void *context, size_t k, uint32_t corner[3])
{
    const struct aiMesh *mesh = context;
    for (unsigned c = 0; c < 3; c++)
        corner[c] = mesh->mFaces[k].mNumIndices == 3 ? mesh->mFaces[k].mIndices[c] : 0; /* a point or line: no area, left out */
}

static void read_geometry(void *context, uint32_t v, struct kiln_vec3 *position, struct kiln_vec3 *normal)
{
    const struct aiMesh *mesh = context;
    *position = vec3(mesh->mVertices[v].x, mesh->mVertices[v].y, mesh->mVertices[v].z);
    if (mesh->mNormals != NULL)
        *normal = vec3(mesh->mNormals[v].x, mesh->mNormals[v].y, mesh->mNormals[v].z);
}

static void read_attributes(void *context, uint32_t v, struct kiln_attributes *out)
{
    const struct aiMesh *mesh = context;
    if (mesh->mTextureCoords[0] != NULL) {
        out->base = (struct kiln_vec2){mesh->mTextureCoords[0][v].x, 1.0f - mesh->mTextureCoords[0][v].y};
        out->emission = out->lightmap = out->base;
    }
    if (mesh->mColors[0] == NULL)
        return;
    const float color[4] = {mesh->mColors[0][v].r, mesh->mColors[0][v].g, mesh->mColors[0][v].b, mesh->mColors[0][v].a};
    for (int c = 0; c < 4; c++)
        out->color[c] = (uint8_t)(fminf(fmaxf(color[c], 0.0f), 1.0f) * 255.0f + 0.5f);
}

/* All faces of a node are one mesh. */
static uint32_t add_mesh(struct reader *r, const struct aiNode *node)
{
    uint32_t index = KILN_NONE;
    bool layout = true;
    take(r, kiln_mesh_begin(r->builder, node->mName.data, &index, r->error));
    for (unsigned i = 0; i < node->mNumMeshes && r->status == KILN_OK; i++) {
        const struct aiMesh *mesh = r->scene->mMeshes[node->mMeshes[i]];
        char where[640];
        (void)snprintf(where, sizeof where, "%.512s: mesh '%.80s'", r->confine->scene, mesh->mName.data);
        const struct kiln_primitive primitive = {.where = where, .context = (void *)(uintptr_t)mesh, .vertex_count = mesh->mNumVertices,
                                                 .triangle_count = mesh->mNumFaces, .has_normals = mesh->mNormals != NULL,
                                                 .material = mesh->mMaterialIndex, .corners = read_corners, .geometry = read_geometry,
                                                 .attributes = read_attributes};
        const struct kiln_material *material = &KILN_BUILDER_DATA(r->builder, struct kiln_material, KILN_SECTION_MATERIALS)[mesh->mMaterialIndex];
        layout &= mesh->mTextureCoords[0] != NULL && material->base_color_texture == KILN_NONE && material->emission_texture == KILN_NONE;
        for (unsigned k = 0; k < mesh->mNumFaces; k++)
            r->not_triangles += mesh->mFaces[k].mNumIndices != 3;
        take(r, kiln_mesh_add(r->builder, index, &primitive, &r->assembly, r->error));
    }
    if (r->status != KILN_OK)
        return KILN_NONE;
    if (KILN_BUILDER_DATA(r->builder, struct kiln_mesh, KILN_SECTION_MESHES)[index].triangle_count == 0) {
        r->builder->sections[KILN_SECTION_MESHES].count--;
        return KILN_NONE;
    }
    r->builder->mesh_has_lightmap_uv[index] = layout;
    return index;
}

static void add_node(struct reader *r, const struct aiNode *node, const double world[12])
{
    char name[KILN_NAME_LENGTH + 1];
    bool skipped = false;
    const uint32_t mesh = add_mesh(r, node);
    if (mesh == KILN_NONE)
        return;
    take(r, kiln_names_unique(&r->names, node->mName.data, name, r->error));
    if (r->status == KILN_OK)
        take(r, kiln_object_add(r->builder, mesh, world, name, node->mName.data, NULL, r->confine->scene, &skipped, r->error));
    r->without_area_objects += skipped;
}

struct visit {
    const struct aiNode *node;
    double world[12];
};

/* The tree, without recursion; children in the file's order. */
static void add_tree(struct reader *r)
{
    struct visit *stack = NULL;
    size_t capacity = 0, depth = 1;
    take(r, kiln_grow(&stack, &capacity, 1, sizeof *stack, "nodes", r->error));
    if (r->status != KILN_OK)
        return;
    stack[0] = (struct visit){r->scene->mRootNode, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    while (depth > 0 && r->status == KILN_OK) {
        const struct visit parent = stack[--depth];
        const struct aiMatrix4x4 *m = &parent.node->mTransformation;
        const double local[12] = {(double)m->a1, (double)m->a2, (double)m->a3, (double)m->a4, (double)m->b1, (double)m->b2,
                                  (double)m->b3, (double)m->b4, (double)m->c1, (double)m->c2, (double)m->c3, (double)m->c4};
        double world[12];
        for (int row = 0; row < 3; row++)
            for (int c = 0; c < 4; c++) {
                world[4 * row + c] = c == 3 ? parent.world[4 * row + 3] : 0.0;
                for (int k = 0; k < 3; k++)
                    world[4 * row + c] += parent.world[4 * row + k] * local[4 * k + c];
            }
        if (parent.node->mNumMeshes > 0)
            add_node(r, parent.node, world);
        const unsigned children = parent.node->mNumChildren;
        take(r, kiln_grow(&stack, &capacity, depth + children, sizeof *stack, "nodes", r->error));
        for (unsigned i = 0; i < children && r->status == KILN_OK; i++) {
            stack[depth].node = parent.node->mChildren[children - 1 - i];
            memcpy(stack[depth++].world, world, sizeof world);
        }
    }
    kiln_free(&stack);
}

static void write_notes(struct reader *r)
{
    const struct {
        uint64_t count;
        const char *text;
    } notes[] = {{r->assembly.without_area, "triangles without area were left out"},
                 {r->assembly.replaced_normals, "corner normals were zero or behind their triangle; the geometric normal took their place"},
                 {r->not_triangles, "points or lines were left out (they count among the triangles without area)"},
                 {r->without_area_objects, "objects are scaled to nothing and were left out"}};
    for (size_t i = 0; i < sizeof notes / sizeof notes[0]; i++)
        if (notes[i].count > 0)
            take(r, kiln_builder_note(r->builder, 1, r->error, "%llu %s", (unsigned long long)notes[i].count, notes[i].text));
    const struct kiln_environment none = {0};
    take(r, kiln_builder_append(r->builder, KILN_SECTION_ENVIRONMENT, &none, 1, NULL, r->error));
}

/* Reads the scene's own file once before Assimp does, when it is an OBJ in a one-byte encoding. */
static void check_text(struct reader *r)
{
    const char *dot = strrchr(r->confine->name, '.');
    struct kiln_file file;
    if (dot == NULL || strcasecmp(dot, ".obj") != 0)
        return;
    take(r, kiln_confine_map(r->confine, r->builder, r->confine->name, "the scene", &file, r->error));
    if (r->status != KILN_OK)
        return;
    const bool wide = file.size >= 2 && ((file.data[0] == 0xff && file.data[1] == 0xfe) || (file.data[0] == 0xfe && file.data[1] == 0xff));
    const size_t mark = file.size >= 3 && memcmp(file.data, "\xef\xbb\xbf", 3) == 0 ? 3 : 0;
    if (!wide)
        take(r, kiln_obj_check(r->confine->scene, file.data + mark, file.size - mark, r->error));
    kiln_file_unmap(&file);
}

int kiln_obj_read(struct kiln_confine *confine, struct kiln_builder *builder, struct kiln_error *error)
{
    struct reader r = {.confine = confine, .builder = builder, .error = error, .images = {.confine = confine, .builder = builder}};
    check_text(&r);
    if (r.status != KILN_OK)
        return r.status;
    struct aiFileIO io = {.OpenProc = file_open, .CloseProc = file_close, .UserData = (aiUserData)(void *)&r};
    r.scene = aiImportFileEx(confine->name, aiProcess_Triangulate | aiProcess_JoinIdenticalVertices | aiProcess_ValidateDataStructure, &io);
    if (r.scene == NULL)
        take(&r, kiln_fail(error, KILN_BAD_INPUT, "%.512s: it cannot be read (Assimp: %.300s); repair the file or export it as glTF",
                           confine->scene, aiGetErrorString()));
    if (r.status == KILN_OK && (r.scene->mNumMeshes == 0 || r.scene->mNumMaterials == 0 || r.scene->mRootNode == NULL))
        take(&r, kiln_fail(error, KILN_BAD_INPUT, "%.512s: it has no mesh; there is nothing to bake", confine->scene));
    for (unsigned i = 0; r.status == KILN_OK && i < r.scene->mNumMaterials; i++)
        add_material(&r, r.scene->mMaterials[i]);
    if (r.status == KILN_OK)
        add_tree(&r);
    if (r.status == KILN_OK)
        write_notes(&r);
    if (r.scene != NULL)
        aiReleaseImport(r.scene);
    kiln_names_destroy(&r.names);
    kiln_images_destroy(&r.images);
    return r.status;
}
