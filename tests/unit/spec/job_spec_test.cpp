#include "common/spec/job_spec.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "tests/support/temp_folder.h"

namespace pf {
namespace {

constexpr std::string_view kMinimal = "[job]\nname = \"glass\"\n[scene]\nfile = \"glass.gltf\"\n";

// The job file of the contract, and a value other than the default for every other key.
constexpr std::string_view kFull = R"(
spec_version = 1
[job]
name = "glass-caustic"
priority = 70
[scene]
file = "./scenes//glass-caustic.gltf"
environment = "sky/Noon.HDR"
environment_scale = 2
camera = "Küche \"links\""
scene = "1"
lens_radius = 0.05
focus_distance = 3.5
[image]
width = 320
height = 200
exposure = -1.5
[integrator]
type = "sppm"
mode = "independent"
photons = 1000
round_growth = 0.5
error_estimate = true
guide_emission = "off"
light_samples = 3
alpha = 0.7
initial_radius = 0.01
max_depth = 8
seed = 9223372036854775807
[stop]
passes = 16
seconds = 0.1
error = 1e-3
memory = 13
[checkpoint]
seconds = 5
[faults]
max_attempts = 3
unit_timeout_seconds = 60.5
[ppm]
eye_samples = 5
hit_points = 6
[photon_map]
caustic_photons = 7
caustic_map = "on"
nearest = 8
caustic_nearest = 9
max_distance = 0.25
filter = "gaussian"
projection_map = "off"
show_map = true
[final_gather]
rays = 10
importance = 0.125
precompute = false
error = 0.5
[irradiance_cache]
error = 0.25
rays = 11
min_spacing = 2
max_spacing = 12
source = "path"
[cache]
file = "a.pfcache"
[photon_splat]
kernel = "cone"
differentials = false
smoothing = 2
)";

constexpr std::string_view kFullCanonical =
    R"({"cache":{"file":"a.pfcache"},"checkpoint":{"seconds":5.0},)"
    R"("faults":{"max_attempts":3,"unit_timeout_seconds":60.5},)"
    R"("final_gather":{"error":0.5,"importance":0.125,"precompute":false,"rays":10},)"
    R"("image":{"exposure":-1.5,"height":200,"width":320},)"
    R"("integrator":{"alpha":0.7,"error_estimate":true,"guide_emission":"off","initial_radius":0.01,"light_samples":3,"max_depth":8,"mode":"independent",)"
    R"("photons":1000,"round_growth":0.5,"seed":9223372036854775807,"type":"sppm"},)"
    R"("irradiance_cache":{"error":0.25,"max_spacing":12.0,"min_spacing":2.0,"rays":11,"source":"path"},)"
    R"("job":{"name":"glass-caustic","priority":70},)"
    R"("photon_map":{"caustic_map":"on","caustic_nearest":9,"caustic_photons":7,"filter":"gaussian","max_distance":0.25,)"
    R"("nearest":8,"projection_map":"off","show_map":true},)"
    R"("photon_splat":{"differentials":false,"kernel":"cone","smoothing":2.0},"ppm":{"eye_samples":5,"hit_points":6},)"
    R"("scene":{"camera":"Küche \"links\"","environment":"sky/Noon.HDR","environment_radiance":[],)"
    R"("environment_scale":2.0,"file":"scenes/glass-caustic.gltf","focus_distance":3.5,"lens_radius":0.05,)"
    R"("scene":"1"},"spec_version":1,"stop":{"error":0.001,"memory":13,"passes":16,"seconds":0.1}})";

JobSpec parsed(std::string_view toml, const std::vector<std::string>& overrides = {}) {
  auto job = parse_job_toml(toml, "job.toml", overrides);
  EXPECT_TRUE(job) << job.error().message;
  return job.value_or(JobSpec{});
}

std::string refusal(const std::string& argument) {
  const auto job = parse_job_toml(kMinimal, "job.toml", {argument});
  return job ? "accepted" : job.error().message;
}

TEST(JobSpec, FillsInTheDefaultsOfItsFields) {
  JobSpec expected;
  expected.job.name = "glass";
  expected.scene.file = "glass.gltf";
  EXPECT_EQ(canonical_json(parsed(kMinimal)), canonical_json(expected));
}

TEST(JobSpec, RefusesNumbersForBooleans) {
  EXPECT_EQ(refusal("final_gather.precompute=1"),
            "--set final_gather.precompute=1: final_gather.precompute is the integer 1; expected true or false");
}

TEST(JobSpec, ReadsEveryKey) {
  const JobSpec spec = parsed(kFull);
  EXPECT_EQ(spec.scene.file, "scenes/glass-caustic.gltf");
  EXPECT_EQ(spec.integrator.type, IntegratorType::kSppm);
  EXPECT_EQ(spec.integrator.mode, ProgressiveMode::kIndependent);
  EXPECT_EQ(spec.integrator.seed, 9223372036854775807u);
  EXPECT_EQ(spec.stop.seconds, 0.1);
  EXPECT_EQ(canonical_json(spec), kFullCanonical);
}

TEST(JobSpec, SurvivesTheWayThroughCanonicalJson) {
  const std::string canonical = canonical_json(parsed(kFull));
  const auto again = parse_job_json(canonical, "job.json");
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(canonical_json(*again), canonical);
  const std::string minimal = canonical_json(parsed(kMinimal));
  EXPECT_EQ(canonical_json(parse_job_json(minimal, "job.json").value()), minimal);
}

TEST(JobSpec, TakesWholeNumbersForRealsAndArraysOfThem) {
  const JobSpec spec = parsed(std::string(kMinimal) + "environment_radiance = [0, 0.5, 1]\nlens_radius = 1\n");
  EXPECT_EQ(spec.scene.environment_radiance, (std::vector<double>{0, 0.5, 1}));
  EXPECT_EQ(spec.scene.lens_radius, 1.0);
}

TEST(JobSpec, TakesPathsThatStayInTheFolder) {
  for (const std::string file : {"a/../b.glb", "a/b/c.GLTF", "..a/b.gltf", "a..gltf"}) {
    EXPECT_TRUE(parse_job_toml(kMinimal, "job.toml", {"scene.file=" + file})) << file;
  }
  EXPECT_EQ(parsed(kMinimal, {"scene.file=a/../b.glb"}).scene.file, "b.glb");
}

TEST(JobSpec, TakesPassesOfZeroWithAnotherBound) {
  EXPECT_EQ(parsed(kMinimal, {"stop.passes=0", "stop.seconds=1.5"}).stop.seconds, 1.5);
  EXPECT_EQ(parsed(kMinimal, {"stop.passes=0", "stop.error=0.01"}).stop.error, 0.01);
}

TEST(JobSpec, KnowsNoNegativeZero) {
  EXPECT_EQ(canonical_json(parsed(kMinimal, {"image.exposure=-0.0"})), canonical_json(parsed(kMinimal)));
}

TEST(JobSpec, NamesItsEnumerations) {
  EXPECT_EQ(to_string(IntegratorType::kAuto), "auto");
  EXPECT_EQ(to_string(IntegratorType::kIrradianceCache), "irradiance_cache");
  EXPECT_EQ(to_string(IntegratorType::kSppm), "sppm");
  EXPECT_EQ(to_string(ProgressiveMode::kShared), "shared");
  EXPECT_EQ(to_string(ProgressiveMode::kIndependent), "independent");
}

TEST(JobSpec, RefusesHugeAndHostileTextsQuickly) {
  const std::size_t megabyte = std::size_t{1} << 20;
  const auto repeat = [&](std::string_view piece) {
    std::string text;
    while (text.size() + piece.size() <= megabyte) text += piece;
    return text;
  };
  EXPECT_FALSE(parse_job_toml(std::string(megabyte + 1, ' '), "job.toml"));
  for (const std::string_view piece : {"[", "{", "a.", "[a.b]\n", "a={", "\"", "'", "\"\"\"", "\\", "x=[[\n", "#\r"}) {
    EXPECT_FALSE(parse_job_toml(repeat(piece), "job.toml")) << piece;
    EXPECT_FALSE(parse_job_toml("v = " + repeat(piece).substr(4), "job.toml")) << piece;
    EXPECT_FALSE(parse_job_json(repeat(piece), "job.json")) << piece;
  }
  EXPECT_FALSE(parse_job_json(repeat("{\"a\":"), "job.json"));
  std::string many = "{";
  for (int i = 0; many.size() < megabyte - 100; ++i) many += "\"k" + std::to_string(i) + "\":1,";
  EXPECT_FALSE(parse_job_json(many + "\"z\":1}", "job.json"));
}

TEST(JobSpec, CountsNoDotsInStringsAndComments) {
  const std::string dots(2000, '.');
  EXPECT_TRUE(parse_job_toml("# " + dots + "\n" + std::string(kMinimal), "job.toml"));
  const std::string camera = "camera = \"\"\"a\"b\"\"" + std::string(200, '.') + "\"\"\"\" # '\n";
  EXPECT_EQ(parsed(std::string(kMinimal) + camera).scene.camera, "a\"b\"\"" + std::string(200, '.') + "\"");
  EXPECT_FALSE(parse_job_toml(std::string(kMinimal) + "camera = '" + dots + "'", "job.toml"));  // but too long
}

TEST(JobSpec, TakesTextBeyondAsciiInStringsAndComments) {
  const std::string text = "\xef\xbb\xbf# Küche\n" + std::string(kMinimal) + "camera = \"Küche\" # Küche\n";
  EXPECT_EQ(parsed(text).scene.camera, "Küche");
  EXPECT_EQ(parsed(std::string(kMinimal) + "camera = \"\"\"\\\n  Üb\"\"\"").scene.camera, "Üb");
}

TEST(Overrides, WinOverTheFileAndTheLastOneWins) {
  const JobSpec spec = parsed(kFull, {"stop.passes=64", "integrator.type=\"ppm\"", "stop.passes = 128 "});
  EXPECT_EQ(spec.stop.passes, 128);
  EXPECT_EQ(spec.integrator.type, IntegratorType::kPpm);
}

TEST(Overrides, TakeStringsWithAndWithoutQuotes) {
  EXPECT_EQ(parsed(kMinimal, {"integrator.type=ppm"}).integrator.type, IntegratorType::kPpm);
  EXPECT_EQ(parsed(kMinimal, {"integrator.type='ppm'"}).integrator.type, IntegratorType::kPpm);
  EXPECT_EQ(parsed(kMinimal, {"scene.scene=1"}).scene.scene, "1");
  EXPECT_EQ(parsed(kMinimal, {"scene.camera=Camera = 2"}).scene.camera, "Camera = 2");
  EXPECT_EQ(parsed(kMinimal, {"scene.camera="}).scene.camera, "");
}

TEST(Overrides, TakeArrays) {
  EXPECT_EQ(parsed(kMinimal, {"scene.environment_radiance=[1, 1.0, 1]"}).scene.environment_radiance.size(), 3u);
}

TEST(Overrides, MayGiveWhatTheFileLacks) {
  EXPECT_EQ(parsed("[scene]\nfile = \"a.glb\"\n", {"job.name=late"}).job.name, "late");
}

TEST(Overrides, AreNamedByTheirErrors) {
  EXPECT_EQ(refusal("stop.pases=64"),
            "--set stop.pases=64: unknown key 'stop.pases'; expected one of passes, "
            "seconds, error, memory; did you mean 'stop.passes'?");
  EXPECT_EQ(refusal("stpo.passes=64"),
            "--set stpo.passes=64: unknown table 'stpo'; expected one of job, scene, "
            "image, integrator, ppm, photon_map, final_gather, irradiance_cache, cache, photon_splat, stop, "
            "checkpoint, faults; did you mean 'stop'?");
  EXPECT_EQ(refusal("passes=64"),
            "--set passes=64: unknown key 'passes'; expected one of spec_version, job, scene, "
            "image, integrator, ppm, photon_map, final_gather, irradiance_cache, cache, photon_splat, stop, "
            "checkpoint, faults; did you mean 'stop.passes'?");
  EXPECT_EQ(refusal("stop={passes=1}"),
            "--set stop={passes=1}: 'stop' is a table; expected --set stop.key=value "
            "with a key out of passes, seconds, error, memory");
  EXPECT_EQ(refusal("stop.passes"), "--set stop.passes: no '='; expected --set table.key=value");
  EXPECT_EQ(refusal("stop.passes=64.0"),
            "--set stop.passes=64.0: stop.passes is the real number 64.0; expected an "
            "integer from 0 to 4294967295 (sub-passes); write 64");
  EXPECT_EQ(refusal("stop.passes=many"),
            "--set stop.passes=many: many is not a TOML value; expected an integer "
            "from 0 to 4294967295 (sub-passes)");
  EXPECT_EQ(refusal("stop.passes="),
            "--set stop.passes=: nothing is not a TOML value; expected an integer from 0 "
            "to 4294967295 (sub-passes)");
  EXPECT_EQ(refusal("stop.passes=0"),
            "--set stop.passes=0: the job has no end; expected stop.passes, stop.seconds "
            "or stop.error above 0");
  EXPECT_EQ(refusal("job.name=a b"),
            "--set job.name=a b: job.name is \"a b\"; expected a string of 1 to 100 "
            "characters out of A-Z a-z 0-9 . _ -, other than . and ..");
}

TEST(Overrides, CannotBringFurtherKeysOrBrokenText) {
  EXPECT_NE(refusal("stop.passes=1\nseconds=2"), "accepted");
  EXPECT_NE(refusal("integrator.type=\"ppm\"\n[job]"), "accepted");
  EXPECT_NE(refusal("scene.camera=a\x01"), "accepted");
  const std::string broken = refusal("job.name=\xff\xfe\n");
  EXPECT_NE(broken.find("\\xff\\xfe\\x0a"), std::string::npos) << broken;
  EXPECT_NE(refusal("scene.camera=\xff"), "accepted");
  EXPECT_NE(refusal(""), "accepted");
  EXPECT_NE(refusal("="), "accepted");
  EXPECT_NE(refusal("."), "accepted");
}

TEST(SpecHash, IsStable) {
  EXPECT_EQ(image_hash_of_spec(parsed(kMinimal)), "1883720b111ce409a7f07432d04d27c046f4c7bf7ff64e9c00221603fb2c1070");
  EXPECT_EQ(image_hash_of_spec(parsed(kFull)), "4b099b9e2878320c9b23966b8738bfbede70b62bf2af3c19e9d5c5cb49e0497f");
}

TEST(SpecHash, DoesNotDependOnTheOrderOfKeysOrOnTheSpelling) {
  const JobSpec other = parsed(
      "integrator.type='auto'\nscene.file='./glass.gltf'\n"
      "image = { height = 480, width = 640 }\njob.name='glass'\n");
  EXPECT_EQ(image_hash_of_spec(other), image_hash_of_spec(parsed(kMinimal)));
}

TEST(SpecHash, IgnoresWhatDoesNotDecideTheImage) {
  const JobSpec other = parsed(kMinimal, {"job.name=other", "job.priority=1", "image.exposure=1", "stop.passes=1",
                                          "stop.seconds=1", "stop.error=1", "stop.memory=1", "checkpoint.seconds=1",
                                          "faults.max_attempts=1", "faults.unit_timeout_seconds=1"});
  EXPECT_EQ(image_hash_of_spec(other), image_hash_of_spec(parsed(kMinimal)));
}

TEST(SpecHash, ChangesWithWhatDecidesTheImage) {
  for (const std::string argument : {"scene.file=b.glb",
                                     "scene.environment=a.exr",
                                     "scene.environment_scale=2",
                                     "scene.camera=b",
                                     "scene.scene=1",
                                     "scene.environment_radiance=[1, 1, 1]",
                                     "scene.lens_radius=1",
                                     "scene.focus_distance=2",
                                     "image.width=1",
                                     "image.height=1",
                                     "integrator.type=path",
                                     "integrator.mode=independent",
                                     "integrator.photons=1",
                                     "integrator.round_growth=1",
                                     "integrator.alpha=1",
                                     "integrator.initial_radius=1",
                                     "integrator.max_depth=1",
                                     "integrator.seed=2",
                                     "ppm.hit_points=1",
                                     "integrator.error_estimate=true",
                                     "integrator.guide_emission=on",
                                     "integrator.light_samples=2",
                                     "photon_map.nearest=1",
                                     "photon_map.caustic_map=off",
                                     "final_gather.precompute=false",
                                     "irradiance_cache.source=path",
                                     "cache.file=a.pfcache",
                                     "photon_splat.kernel=cone"}) {
    EXPECT_NE(image_hash_of_spec(parsed(kMinimal, {argument})), image_hash_of_spec(parsed(kMinimal))) << argument;
  }
}

TEST(PhotonPaths, AreWhatTheJobSays) { EXPECT_EQ(photon_paths(parsed(kMinimal, {"integrator.photons=7"})), 7); }

TEST(PhotonPaths, FollowTheImageWhereTheJobLeavesThemOpen) {
  EXPECT_EQ(photon_paths(parsed(kMinimal, {"image.width=200", "image.height=100"})), 40000);
  EXPECT_EQ(photon_paths(parsed(kMinimal, {"image.width=20", "image.height=10"})), 10000);
  EXPECT_EQ(photon_paths(parsed(kMinimal, {"image.width=2000", "image.height=1000"})), 2000000);
  EXPECT_EQ(photon_paths(parsed(kMinimal, {"integrator.type=photon_map"})), 500000);
}

TEST(PhotonPaths, MayBePlannedOnlyWhereTheJobLeavesThemOpen) {
  EXPECT_TRUE(may_trace(parsed(kMinimal), 10000) && may_trace(parsed(kMinimal), 2000000));
  EXPECT_FALSE(may_trace(parsed(kMinimal), 9999) || may_trace(parsed(kMinimal), 2000001));
  EXPECT_FALSE(may_trace(parsed(kMinimal, {"integrator.photons=20000"}), 20001));
  EXPECT_FALSE(may_trace(parsed(kMinimal, {"integrator.type=ppm"}), 10000));
}

class LoadJob : public testing::Test {
 protected:
  TempFolder temp_;
  const std::filesystem::path& folder_ = temp_.path();
};

TEST_F(LoadJob, ReadsTomlAndJsonByTheirExtension) {
  std::ofstream(folder_ / "a.toml") << kMinimal;
  std::ofstream(folder_ / "a.json") << R"({"job": {"name": "glass"}, "scene": {"file": "glass.gltf"}})";
  const auto toml = load_job(folder_ / "a.toml"), json = load_job(folder_ / "a.json", {"image.width=2"});
  ASSERT_TRUE(toml && json);
  EXPECT_EQ(toml->folder, folder_);
  EXPECT_EQ(json->image.width, 2);
}

TEST_F(LoadJob, NamesTheFileInErrors) {
  std::ofstream(folder_ / "a.toml") << "[job]\nname = 1\n";
  const auto bad = load_job(folder_ / "a.toml");
  ASSERT_FALSE(bad);
  EXPECT_TRUE(bad.error().message.starts_with((folder_ / "a.toml").string() + ":2:8: job.name is the integer 1; "));
  const auto absent = load_job(folder_ / "b.toml");
  ASSERT_FALSE(absent);
  EXPECT_EQ(exit_code(absent.error().kind), 2);
}

}  // namespace
}  // namespace pf
