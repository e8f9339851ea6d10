// Khronos's validator over the .glb files it is given: the issues of each, as JSON.
const fs = require('fs');
const validator = require('gltf-validator');
(async () => {
  const reports = [];
  for (const path of process.argv.slice(1)) {
    try {
      reports.push(await validator.validateBytes(new Uint8Array(fs.readFileSync(path)), { uri: path }));
    } catch (error) {
      reports.push({ refused: String(error) });
    }
  }
  process.stdout.write(JSON.stringify(reports));
})();
