#include "coordinator/import/draco_decode.h"

#include <cstdio>
#include <exception>
#include <memory>
#include <new>

#include <draco/compression/decode.h>

struct kiln_draco {
    std::unique_ptr<draco::Mesh> mesh;
};

namespace
{

void say(char *reason, size_t size, const char *text) { (void)std::snprintf(reason, size, "%s", text); }

/* One vertex's values. Integers are read as 64 bits, so that none is normalised. */
bool read_value(const draco::PointAttribute &attribute, draco::PointIndex vertex, unsigned components, float *values)
{
    const draco::AttributeValueIndex index = attribute.mapped_index(vertex);
    if (index.value() >= attribute.size())
        return false;
    if (attribute.data_type() == draco::DT_FLOAT32 || attribute.data_type() == draco::DT_FLOAT64)
        return attribute.ConvertValue<float>(index, static_cast<int8_t>(components), values);
    int64_t whole[4] = {0, 0, 0, 0};
    if (!attribute.ConvertValue<int64_t>(index, static_cast<int8_t>(components), whole))
        return false;
    for (unsigned c = 0; c < components; c++)
        values[c] = static_cast<float>(whole[c]);
    return true;
}

} // namespace

extern "C" {

struct kiln_draco *kiln_draco_decode(const void *data, size_t size, char *reason, size_t reason_size)
{
    try {
        draco::DecoderBuffer buffer;
        draco::Decoder decoder;
        buffer.Init(static_cast<const char *>(data), size);
        auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
        if (!decoded.ok()) {
            say(reason, reason_size, decoded.status().error_msg());
            return nullptr;
        }
        std::unique_ptr<draco::Mesh> mesh = std::move(decoded).value();
        if (mesh == nullptr) {
            say(reason, reason_size, "there is no mesh in it");
            return nullptr;
        }
        return new kiln_draco{std::move(mesh)};
    } catch (const std::bad_alloc &) {
        say(reason, reason_size, "it asks for more memory than there is");
    } catch (const std::exception &e) {
        say(reason, reason_size, e.what());
    } catch (...) {
        say(reason, reason_size, "the decoder gave up");
    }
    return nullptr;
}

void kiln_draco_destroy(struct kiln_draco **draco)
{
    delete *draco;
    *draco = nullptr;
}

size_t kiln_draco_vertex_count(const struct kiln_draco *draco) { return draco->mesh->num_points(); }
size_t kiln_draco_triangle_count(const struct kiln_draco *draco) { return draco->mesh->num_faces(); }

void kiln_draco_corners(const struct kiln_draco *draco, uint32_t *corners)
{
    for (uint32_t i = 0; i < draco->mesh->num_faces(); i++) {
        const draco::Mesh::Face &face = draco->mesh->face(draco::FaceIndex(i));
        for (size_t c = 0; c < 3; c++)
            corners[3 * static_cast<size_t>(i) + c] = face[c].value();
    }
}

bool kiln_draco_attribute(const struct kiln_draco *draco, uint32_t id, unsigned components, float *values)
{
    const draco::PointAttribute *attribute = draco->mesh->GetAttributeByUniqueId(id);
    if (attribute == nullptr || attribute->num_components() != static_cast<int>(components) || components > 4)
        return false;
    for (uint32_t i = 0; i < draco->mesh->num_points(); i++)
        if (!read_value(*attribute, draco::PointIndex(i), components, values + static_cast<size_t>(i) * components))
            return false;
    return true;
}
}
