/* The lightmap as a store (worker/store/lightmap.h): barycentrics -> texel -> tile -> surface point. With HAS_OCTREE it
 * is the octree, which finds the tile differently (store_octree.glsl). */

#include "shaders/shared/store_lightmap.h"

KILN_ARRAY(Lightmaps, kiln_gpu_lightmap, 8);
KILN_ARRAY(TileWords, uvec4, 16);
KILN_ARRAY(DividedArray, kiln_gpu_divided, 8);

#include "shaders/store_octree.glsl"

/* Number of bits of `mask` below `bit`. */
uint kiln_bits_below(uvec2 mask, uint bit)
{
    const uint inside = (1u << (bit & 31u)) - 1u;
    return bit < 32u ? bitCount(mask.x & inside) : bitCount(mask.x) + bitCount(mask.y & inside);
}

bool kiln_bit_set(uvec2 mask, uint bit) { return ((bit < 32u ? mask.x >> bit : mask.y >> (bit - 32u)) & 1u) != 0u; }

/* Place in the store for a hit on a world triangle. */
struct kiln_store_way {
    uint object, material; /* material as in struct kiln_hit_record, flags included */
    uint64_t tile;         /* address of the tile; 0: in an octree, outside every brick */
    uint bit;              /* of the texel in the tile */
    vec2 place;            /* in the texel, 0 to 1; set where HAS_DIVIDED */
};

/* Finds the place of a hit. `back`: on the back of a two-sided triangle; backs have a lightmap of their own. */
kiln_store_way kiln_store_enter(uint triangle, float u, float v, bool back)
{
    RecordHalves halves = RecordHalves(SCENE.records + uint64_t(triangle) * 32ul);
    const vec4 a = halves.at[0], b = halves.at[1];
    kiln_store_way to;
    to.object = floatBitsToUint(b.z);
    to.material = floatBitsToUint(b.w);
    const float along = kiln_texel_coordinate(a.x, a.z, b.x, u, v), down = kiln_texel_coordinate(a.y, a.w, b.y, u, v);
    if (HAS_OCTREE != 0u) {
        const bool behind = back && (to.material & KILN_RECORD_DOUBLE_SIDED) != 0u;
        kiln_octree_enter(triangle, u, v, behind, to.object, along, down, to.tile, to.bit);
        to.place = fract(vec2(along, down));
        return to;
    }
    kiln_gpu_lightmap map = Lightmaps(SCENE.store.lightmaps).at[to.object];
    int x = kiln_texel_of(along, int(map.width) - 1), y = kiln_texel_of(down, int(map.height) - 1);
    if (back && (to.material & KILN_RECORD_DOUBLE_SIDED) != 0u) {
        map = Lightmaps(SCENE.store.lightmaps).at[SCENE.object_count + to.object];
        x >>= map.shift;
        y >>= map.shift;
    }
    if (HAS_DIVIDED != 0u)
        to.place = fract(vec2(along, down) * (back ? 1.0 / float(1u << map.shift) : 1.0));
    to.tile = SCENE.store.tiles + (map.tile_first + kiln_tile_of(uint(x), uint(y), map.tiles_x)) * 16ul;
    to.bit = kiln_morton8(uint(x) & 7u, uint(y) & 7u);
    return to;
}

/* Finds the point of a divided texel that contains `place` (kiln_divided_choose); false: there is none. */
bool kiln_divided_choose(uint64_t number, vec2 place, out uint64_t point)
{
    const kiln_gpu_divided texel = DividedArray(SCENE.store.divided + number * uint64_t(KILN_GPU_DIVIDED_BYTES)).at[0];
    uint sure = 0u, perhaps = 0u;
    for (uint i = 0u; i < texel.line_count; i++)
        kiln_cut_add(texel.lines[3u * i] * place.x + texel.lines[3u * i + 1u] * place.y - texel.lines[3u * i + 2u],
                     texel.margin, i, sure, perhaps);
    const uint part = kiln_cut_subtexel(texel.codes[0], texel.codes[1], sure);
    point = texel.part[min(part, uint(KILN_SUBTEXELS) - 1u)];
    return part < uint(KILN_SUBTEXELS) && part == kiln_cut_subtexel(texel.codes[0], texel.codes[1], perhaps) &&
           point != ~0ul;
}

/* Finds the surface point at a place in the store; false: there is none. */
bool kiln_store_point(kiln_store_way to, out uint64_t point)
{
    point = 0ul;
    if (HAS_OCTREE != 0u && to.tile == 0ul)
        return false;
    uvec4 tile = TileWords(to.tile).at[0];
    if (!kiln_bit_set(tile.xy, to.bit))
        return false;
    if ((tile.w & KILN_TILE_SPLIT_HIGH) != 0u) { /* the tile lies in several cells: look for the part */
        uint64_t part = SCENE.store.splits + (uint64_t(tile.w & ~KILN_TILE_SPLIT_HIGH) << 32 | tile.z) * 16ul;
        tile = TileWords(part).at[0];
        while (!kiln_bit_set(tile.xy, to.bit)) {
            part += 16ul;
            tile = TileWords(part).at[0];
        }
        if (HAS_DIVIDED != 0u && (tile.w & KILN_TILE_SPLIT_HIGH) != 0u)
            return kiln_divided_choose(uint64_t(tile.w & ~KILN_TILE_SPLIT_HIGH) << 32 | tile.z, to.place, point);
    }
    point = (uint64_t(tile.w) << 32 | tile.z) + kiln_bits_below(tile.xy, to.bit);
    return true;
}

/* Radiosity at a place in the store, W/m2; 0 if there is no point. */
vec3 kiln_store_radiosity(kiln_store_way to)
{
    uint64_t point;
    if (!kiln_store_point(to, point))
        return vec3(0.0);
    return kiln_radiosity_unpack(RadiosityWords(SCENE.radiosity + point * 8ul).at[0]);
}
