#include "shaders/compile/glsl.h"

#include <glslang/Public/ResourceLimits.h>
#include <glslang/Public/ShaderLang.h>
#include <glslang/SPIRV/GlslangToSpv.h>

#include <fstream>
#include <map>
#include <mutex>
#include <sstream>
#include <stdexcept>

namespace kiln
{

namespace
{

constexpr int DEFAULT_VERSION = 100; /* of a source without #version; all have one */
constexpr auto MESSAGES = static_cast<EShMessages>(EShMsgSpvRules | EShMsgVulkanRules);

EShLanguage stage_of(const std::string &name)
{
    static const std::map<std::string, EShLanguage> stages = {{"comp", EShLangCompute},
                                                              {"rgen", EShLangRayGen},
                                                              {"rchit", EShLangClosestHit},
                                                              {"rahit", EShLangAnyHit},
                                                              {"rmiss", EShLangMiss}};
    return stages.at(name);
}

/* The text of a file, which is read once. */
const std::string &text_of(const std::string &path)
{
    static std::map<std::string, std::string> texts;
    static std::mutex mutex;
    const std::lock_guard<std::mutex> lock(mutex);
    const auto found = texts.find(path);
    if (found != texts.end())
        return found->second;
    std::ifstream file(path, std::ios::binary);
    std::ostringstream text;
    text << file.rdbuf();
    if (!file)
        throw std::runtime_error(path + ": the file cannot be read");
    return texts.emplace(path, text.str()).first->second;
}

class includer : public glslang::TShader::Includer
{
  public:
    explicit includer(const std::string &folder) : root(folder) {}

    IncludeResult *includeLocal(const char *name, const char *, size_t) override
    {
        const std::string path = root + "/" + name;
        const std::string &text = text_of(path);
        return new IncludeResult(path, text.data(), text.size(), nullptr);
    }

    void releaseInclude(IncludeResult *result) override { delete result; }

  private:
    const std::string &root;
};

/* A source that is ready to be parsed. */
class source
{
  public:
    explicit source(const kernel &k) : shader(stage_of(k.stage)), text(text_of(k.file)), name(k.file)
    {
        for (const std::string &definition : k.definitions) {
            const size_t equals = definition.find('=');
            preamble += "#define " + definition.substr(0, equals) + " " +
                        (equals == std::string::npos ? "" : definition.substr(equals + 1)) + "\n";
        }
        strings[0] = text.c_str();
        names[0] = name.c_str();
        shader.setStringsWithLengthsAndNames(strings, nullptr, names, 1);
        shader.setPreamble(preamble.c_str());
        shader.setEnvInput(glslang::EShSourceGlsl, stage_of(k.stage), glslang::EShClientVulkan, DEFAULT_VERSION);
        shader.setEnvClient(glslang::EShClientVulkan, glslang::EShTargetVulkan_1_2);
        shader.setEnvTarget(glslang::EShTargetSpv, glslang::EShTargetSpv_1_5);
    }

    glslang::TShader shader;

    [[noreturn]] void fail(const char *log) const { throw std::runtime_error(name + ":\n" + log); }

  private:
    const std::string &text;
    std::string name, preamble;
    const char *strings[1], *names[1];
};

/* Lines with something in them that is not only a place. */
std::string without_places(const std::string &text)
{
    std::istringstream lines(text);
    std::string kept;
    for (std::string line; std::getline(lines, line);)
        if (line.find_first_not_of(" \t") != std::string::npos && line.compare(0, 5, "#line") != 0)
            kept += line + "\n";
    return kept;
}

} // namespace

compiler::compiler(std::string folder) : root(std::move(folder)) { glslang::InitializeProcess(); }

compiler::~compiler() { glslang::FinalizeProcess(); }

std::string compiler::preprocess(const kernel &k)
{
    source s(k);
    includer files(root);
    std::string text;
    if (!s.shader.preprocess(GetDefaultResources(), DEFAULT_VERSION, ENoProfile, false, false, MESSAGES, &text, files))
        s.fail(s.shader.getInfoLog());
    return without_places(text);
}

std::vector<uint32_t> compiler::compile(const kernel &k)
{
    source s(k);
    includer files(root);
    if (!s.shader.parse(GetDefaultResources(), DEFAULT_VERSION, false, MESSAGES, files))
        s.fail(s.shader.getInfoLog());
    glslang::TProgram program;
    program.addShader(&s.shader);
    if (!program.link(MESSAGES) || !program.mapIO())
        s.fail(program.getInfoLog());
    std::vector<uint32_t> words;
    spv::SpvBuildLogger log;
    glslang::SpvOptions options;
    glslang::GlslangToSpv(*program.getIntermediate(stage_of(k.stage)), words, &log, &options);
    if (!log.getAllMessages().empty())
        s.fail(log.getAllMessages().c_str());
    return words;
}

/* ---- SPIR-V's binary form (specification, sections 2.3 and 3.42) ---- */

namespace
{

enum {
    BOUND = 3, /* above all results */
    FIRST_INSTRUCTION = 5,
    OP_SOURCE_CONTINUED = 2,
    OP_SOURCE = 3,
    OP_SOURCE_EXTENSION = 4,
    OP_NAME = 5,
    OP_MEMBER_NAME = 6,
    OP_STRING = 7,
    OP_LINE = 8,
    OP_SPEC_CONSTANT = 50,
    OP_DECORATE = 71,
    OP_NO_LINE = 317,
    OP_MODULE_PROCESSED = 330,
    DECORATION_SPEC_ID = 1
};

uint32_t operation(uint32_t word) { return word & 0xffffu; }

uint32_t length(uint32_t word) { return word >> 16; }

bool is_for_readers(uint32_t op)
{
    return (op >= OP_SOURCE_CONTINUED && op <= OP_LINE) || op == OP_NO_LINE || op == OP_MODULE_PROCESSED;
}

} // namespace

std::vector<uint32_t> strip(const std::vector<uint32_t> &words)
{
    std::vector<uint32_t> kept(words.begin(), words.begin() + FIRST_INSTRUCTION);
    for (size_t i = FIRST_INSTRUCTION; i < words.size(); i += length(words[i]))
        if (!is_for_readers(operation(words[i])))
            kept.insert(kept.end(), words.begin() + static_cast<ptrdiff_t>(i),
                        words.begin() + static_cast<ptrdiff_t>(i + length(words[i])));
    return kept;
}

uint32_t constants_asked(const std::vector<uint32_t> &words)
{
    constexpr uint32_t NONE = 32;
    std::vector<uint32_t> constants(words[BOUND], NONE); /* by result: its number */
    uint32_t asked = 0;
    for (size_t i = FIRST_INSTRUCTION; i < words.size(); i += length(words[i])) {
        const uint32_t op = operation(words[i]);
        if (op == OP_DECORATE && words[i + 2] == DECORATION_SPEC_ID)
            constants[words[i + 1]] = words[i + 3];
        if (op == OP_DECORATE || op == OP_SPEC_CONSTANT || is_for_readers(op))
            continue;
        for (uint32_t k = 1; k < length(words[i]); k++)
            if (words[i + k] < constants.size() && constants[words[i + k]] != NONE)
                asked |= 1u << constants[words[i + k]];
    }
    return asked;
}

} // namespace kiln
