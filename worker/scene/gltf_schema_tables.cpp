// The properties of glTF 2.0 (section 5, "Properties Reference") and of the supported extensions, as tables.

#include "worker/scene/gltf_schema.h"

namespace pf::gltf {
namespace {

constexpr double kByteMax = 4294967295.0;  // sizes and offsets: a file has at most 4 GiB
constexpr std::string_view kLights = "extensions/KHR_lights_punctual/lights";

constexpr Rule flag(std::string_view name) { return {.name = name, .type = Type::kBoolean}; }
constexpr Rule text(std::string_view name) { return {.name = name, .type = Type::kString}; }
constexpr Rule integer(std::string_view name, double lo = 0) {
  return {.name = name, .type = Type::kInteger, .min = lo, .max = kByteMax};
}
constexpr Rule number(std::string_view name) { return {.name = name, .type = Type::kNumber}; }
constexpr Rule index(std::string_view name, std::string_view collection) {
  return {.name = name, .type = Type::kIndex, .collection = collection};
}
constexpr Rule object(std::string_view name, const Schema& schema) {
  return {.name = name, .type = Type::kObject, .schema = &schema};
}
constexpr Rule word(std::string_view name, std::span<const std::string_view> words) {
  return {.name = name, .type = Type::kString, .words = words};
}
constexpr Rule choice(std::string_view name, std::span<const int> values) {
  return {.name = name, .type = Type::kInteger, .values = values};
}
constexpr Rule color(std::string_view name, std::size_t channels) {
  return number(name).list(channels, channels).range(0, 1);
}

constexpr Schema kEmpty{"extension", {}};

// Buffers and accessors
constexpr Rule kBufferRules[] = {text("uri"), integer("byteLength", 1).must()};
constexpr Schema kBuffer{"buffer", kBufferRules};

constexpr int kTargets[] = {34962, 34963};
constexpr Rule kBufferViewRules[] = {index("buffer", "buffers").must(), integer("byteOffset"),
                                     integer("byteLength", 1).must(), integer("byteStride").range(4, 252),
                                     choice("target", kTargets).soft()};
constexpr Schema kBufferView{"bufferView", kBufferViewRules};

constexpr int kComponentTypes[] = {5120, 5121, 5122, 5123, 5125, 5126};
constexpr int kIndexTypes[] = {5121, 5123, 5125};
constexpr std::string_view kAccessorTypes[] = {"SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"};
constexpr double kIntMax = 2147483647.0;  // tinygltf keeps these in an int
constexpr Rule kSparseIndicesRules[] = {index("bufferView", "bufferViews").must(),
                                        integer("byteOffset").range(0, kIntMax),
                                        choice("componentType", kIndexTypes).must()};
constexpr Schema kSparseIndices{"sparse.indices", kSparseIndicesRules};
constexpr Rule kSparseValuesRules[] = {index("bufferView", "bufferViews").must(),
                                       integer("byteOffset").range(0, kIntMax)};
constexpr Schema kSparseValues{"sparse.values", kSparseValuesRules};
constexpr Rule kSparseRules[] = {integer("count").range(1, kIntMax).must(), object("indices", kSparseIndices).must(),
                                 object("values", kSparseValues).must()};
constexpr Schema kSparse{"sparse", kSparseRules};
constexpr Rule kAccessorRules[] = {index("bufferView", "bufferViews"),
                                   integer("byteOffset"),
                                   choice("componentType", kComponentTypes).must(),
                                   flag("normalized"),
                                   integer("count", 1).must(),
                                   word("type", kAccessorTypes).must(),
                                   number("max").list(1, 16).soft(),
                                   number("min").list(1, 16).soft(),
                                   object("sparse", kSparse)};
constexpr Schema kAccessor{"accessor", kAccessorRules};

// Textures
constexpr Rule kImageRules[] = {text("uri"), text("mimeType"), index("bufferView", "bufferViews")};
constexpr Schema kImage{"image", kImageRules};
constexpr int kMagFilters[] = {9728, 9729};
constexpr int kMinFilters[] = {9728, 9729, 9984, 9985, 9986, 9987};
constexpr int kWraps[] = {33071, 33648, 10497};
constexpr Rule kSamplerRules[] = {choice("magFilter", kMagFilters).soft(), choice("minFilter", kMinFilters).soft(),
                                  choice("wrapS", kWraps), choice("wrapT", kWraps)};
constexpr Schema kSampler{"sampler", kSamplerRules};
constexpr Rule kTextureSourceRules[] = {index("source", "images")};
constexpr Schema kTextureSource{"texture extension", kTextureSourceRules};
constexpr ExtensionRule kTextureExtensions[] = {{"EXT_texture_webp", &kTextureSource},
                                                {"KHR_texture_basisu", &kTextureSource}};
// Whether `source` leads anywhere is asked where a material uses the texture: exporters leave unused ones
// dangling.
constexpr Rule kTextureRules[] = {index("sampler", "samplers"), integer("source").range(0, kIntMax)};
constexpr Schema kTexture{"texture", kTextureRules, kTextureExtensions};

constexpr Rule kTransformRules[] = {number("offset").list(2, 2), number("rotation"), number("scale").list(2, 2),
                                    integer("texCoord").range(0, 65535)};
constexpr Schema kTransform{"KHR_texture_transform", kTransformRules};
constexpr ExtensionRule kInfoExtensions[] = {{"KHR_texture_transform", &kTransform}};
constexpr Rule kInfoRules[] = {index("index", "textures").must(), integer("texCoord").range(0, 65535)};
constexpr Schema kInfo{"textureInfo", kInfoRules, kInfoExtensions};
constexpr Rule kNormalInfoRules[] = {index("index", "textures").must(), integer("texCoord").range(0, 65535),
                                     number("scale")};
constexpr Schema kNormalInfo{"normalTextureInfo", kNormalInfoRules, kInfoExtensions};
constexpr Rule kOcclusionInfoRules[] = {index("index", "textures").must(), integer("texCoord").range(0, 65535),
                                        number("strength").range(0, 1).soft()};
constexpr Schema kOcclusionInfo{"occlusionTextureInfo", kOcclusionInfoRules, kInfoExtensions};

// Materials
constexpr Rule kPbrRules[] = {color("baseColorFactor", 4), object("baseColorTexture", kInfo),
                              number("metallicFactor").range(0, 1), number("roughnessFactor").range(0, 1),
                              object("metallicRoughnessTexture", kInfo)};
constexpr Schema kPbr{"pbrMetallicRoughness", kPbrRules};
constexpr Rule kClearcoatRules[] = {number("clearcoatFactor").range(0, 1), object("clearcoatTexture", kInfo),
                                    number("clearcoatRoughnessFactor").range(0, 1),
                                    object("clearcoatRoughnessTexture", kInfo),
                                    object("clearcoatNormalTexture", kNormalInfo)};
constexpr Schema kClearcoat{"KHR_materials_clearcoat", kClearcoatRules};
constexpr Rule kEmissiveStrengthRules[] = {number("emissiveStrength").range(0)};
constexpr Schema kEmissiveStrength{"KHR_materials_emissive_strength", kEmissiveStrengthRules};
constexpr Rule kIorRules[] = {number("ior").range(0)};
constexpr Schema kIor{"KHR_materials_ior", kIorRules};
constexpr Rule kSheenRules[] = {color("sheenColorFactor", 3), object("sheenColorTexture", kInfo),
                                number("sheenRoughnessFactor").range(0, 1), object("sheenRoughnessTexture", kInfo)};
constexpr Schema kSheen{"KHR_materials_sheen", kSheenRules};
constexpr Rule kSpecularRules[] = {number("specularFactor").range(0, 1), object("specularTexture", kInfo),
                                   number("specularColorFactor").list(3, 3).range(0),
                                   object("specularColorTexture", kInfo)};
constexpr Schema kSpecular{"KHR_materials_specular", kSpecularRules};
constexpr Rule kTransmissionRules[] = {number("transmissionFactor").range(0, 1), object("transmissionTexture", kInfo)};
constexpr Schema kTransmission{"KHR_materials_transmission", kTransmissionRules};
constexpr Rule kVolumeRules[] = {number("thicknessFactor").range(0), object("thicknessTexture", kInfo),
                                 number("attenuationDistance").more_than(0), color("attenuationColor", 3)};
constexpr Schema kVolume{"KHR_materials_volume", kVolumeRules};
constexpr ExtensionRule kMaterialExtensions[] = {{"KHR_materials_clearcoat", &kClearcoat},
                                                 {"KHR_materials_emissive_strength", &kEmissiveStrength},
                                                 {"KHR_materials_ior", &kIor},
                                                 {"KHR_materials_sheen", &kSheen},
                                                 {"KHR_materials_specular", &kSpecular},
                                                 {"KHR_materials_transmission", &kTransmission},
                                                 {"KHR_materials_unlit", &kEmpty},
                                                 {"KHR_materials_volume", &kVolume}};
constexpr std::string_view kAlphaModes[] = {"OPAQUE", "MASK", "BLEND"};
constexpr Rule kMaterialRules[] = {object("pbrMetallicRoughness", kPbr),
                                   object("normalTexture", kNormalInfo),
                                   object("occlusionTexture", kOcclusionInfo),
                                   object("emissiveTexture", kInfo),
                                   number("emissiveFactor").list(3, 3).range(0),
                                   word("alphaMode", kAlphaModes),
                                   number("alphaCutoff").range(0),
                                   flag("doubleSided")};
constexpr Schema kMaterial{"material", kMaterialRules, kMaterialExtensions};

// Meshes
constexpr Rule kDracoRules[] = {index("bufferView", "bufferViews").must(),
                                integer("attributes").range(0, kIntMax).map().must()};
constexpr Schema kDraco{"KHR_draco_mesh_compression", kDracoRules};
constexpr ExtensionRule kPrimitiveExtensions[] = {{"KHR_draco_mesh_compression", &kDraco}};
constexpr int kModes[] = {0, 1, 2, 3, 4, 5, 6};
constexpr Rule kPrimitiveRules[] = {index("attributes", "accessors").map().must(), index("indices", "accessors"),
                                    index("material", "materials"), choice("mode", kModes),
                                    index("targets", "accessors").maps()};
constexpr Schema kPrimitive{"primitive", kPrimitiveRules, kPrimitiveExtensions};
constexpr Rule kMeshRules[] = {object("primitives", kPrimitive).list().must(), number("weights").list()};
constexpr Schema kMesh{"mesh", kMeshRules};
constexpr Rule kSkinRules[] = {index("inverseBindMatrices", "accessors"), index("skeleton", "nodes").soft(),
                               index("joints", "nodes").list().must()};
constexpr Schema kSkin{"skin", kSkinRules};

// Scene graph
constexpr Rule kOrthographicRules[] = {number("xmag").must(), number("ymag").must(),
                                       number("zfar").more_than(0).must().soft(),
                                       number("znear").range(0).must().soft()};
constexpr Schema kOrthographic{"camera.orthographic", kOrthographicRules};
constexpr Rule kPerspectiveRules[] = {number("aspectRatio").more_than(0), number("yfov").more_than(0).must(),
                                      number("zfar").more_than(0).soft(), number("znear").more_than(0).must().soft()};
constexpr Schema kPerspective{"camera.perspective", kPerspectiveRules};
constexpr std::string_view kCameraTypes[] = {"perspective", "orthographic"};
constexpr Rule kCameraRules[] = {object("orthographic", kOrthographic), object("perspective", kPerspective),
                                 word("type", kCameraTypes).must()};
constexpr Schema kCamera{"camera", kCameraRules};

constexpr Rule kLightRefRules[] = {index("light", kLights).must()};
constexpr Schema kLightRef{"KHR_lights_punctual", kLightRefRules};
constexpr Rule kInstancingRules[] = {index("attributes", "accessors").map().must()};
constexpr Schema kInstancing{"EXT_mesh_gpu_instancing", kInstancingRules};
constexpr ExtensionRule kNodeExtensions[] = {{"KHR_lights_punctual", &kLightRef},
                                             {"EXT_mesh_gpu_instancing", &kInstancing}};
constexpr Rule kNodeRules[] = {
    index("camera", "cameras"),    index("children", "nodes").list(), index("skin", "skins"),
    number("matrix").list(16, 16), index("mesh", "meshes"),           number("rotation").list(4, 4),
    number("scale").list(3, 3),    number("translation").list(3, 3),  number("weights").list()};
constexpr Schema kNode{"node", kNodeRules, kNodeExtensions};
constexpr Rule kSceneRules[] = {index("nodes", "nodes").list()};
constexpr Schema kScene{"scene", kSceneRules};

constexpr Rule kSpotRules[] = {number("innerConeAngle").range(0), number("outerConeAngle").more_than(0)};
constexpr Schema kSpot{"spot", kSpotRules};
constexpr std::string_view kLightTypes[] = {"directional", "point", "spot"};
constexpr Rule kLightRules[] = {color("color", 3), number("intensity").range(0), word("type", kLightTypes).must(),
                                number("range").more_than(0).soft(), object("spot", kSpot)};
constexpr Schema kLight{"light", kLightRules};
constexpr Rule kRootLightsRules[] = {object("lights", kLight).list().must()};
constexpr Schema kRootLights{"KHR_lights_punctual", kRootLightsRules};
constexpr ExtensionRule kRootExtensions[] = {{"KHR_lights_punctual", &kRootLights}};

// Animations: none is played, so nothing in them can touch the image.
constexpr Rule kChannelTargetRules[] = {index("node", "nodes").soft(), text("path").must().soft()};
constexpr Schema kChannelTarget{"animation.channel.target", kChannelTargetRules};
constexpr Rule kChannelRules[] = {integer("sampler").must().soft(), object("target", kChannelTarget).must().soft()};
constexpr Schema kChannel{"animation.channel", kChannelRules};
constexpr std::string_view kInterpolations[] = {"LINEAR", "STEP", "CUBICSPLINE"};
constexpr Rule kAnimationSamplerRules[] = {index("input", "accessors").must().soft(),
                                           word("interpolation", kInterpolations).soft(),
                                           index("output", "accessors").must().soft()};
constexpr Schema kAnimationSampler{"animation.sampler", kAnimationSamplerRules};
constexpr Rule kAnimationRules[] = {object("channels", kChannel).list().must().soft(),
                                    object("samplers", kAnimationSampler).list().must().soft()};
constexpr Schema kAnimation{"animation", kAnimationRules};

constexpr Rule kAssetRules[] = {text("copyright").soft(), text("generator").soft(), text("version").must(),
                                text("minVersion")};
constexpr Schema kAsset{"asset", kAssetRules};

constexpr Rule kDocumentRules[] = {text("extensionsUsed").list(),
                                   text("extensionsRequired").list(),
                                   object("asset", kAsset).must(),
                                   object("accessors", kAccessor).list(),
                                   object("animations", kAnimation).list().soft(),
                                   object("buffers", kBuffer).list(),
                                   object("bufferViews", kBufferView).list(),
                                   object("cameras", kCamera).list(),
                                   object("images", kImage).list(),
                                   object("materials", kMaterial).list(),
                                   object("meshes", kMesh).list(),
                                   object("nodes", kNode).list(),
                                   object("samplers", kSampler).list(),
                                   index("scene", "scenes"),
                                   object("scenes", kScene).list(),
                                   object("skins", kSkin).list(),
                                   object("textures", kTexture).list()};
constexpr Schema kDocument{"glTF", kDocumentRules, kRootExtensions};

}  // namespace

const Schema& document_schema() { return kDocument; }

}  // namespace pf::gltf
